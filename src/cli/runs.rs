//! Many runs and what comes of them: `experiment`, `benchmark`, `report`, `watch`, `compare`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::{A_YEAR_S, MOST_WORKERS, STUCK, values};

#[derive(Debug, Args)]
pub struct ExperimentArgs {
    /// Experiment file, such as experiments/small_simulators_traffic.toml
    pub file: PathBuf,
    /// Folder for the run directories [default: results/FILE/runs]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Number of cores to use [default: all]
    #[arg(long, value_parser = values::whole::<usize>(1..=MOST_WORKERS))]
    pub cores: Option<usize>,
    /// Only list the runs and estimate time and memory
    #[arg(long)]
    pub dry_run: bool,
    /// Resume runs although this program, SUMO, libm or the vector instructions have changed since
    #[arg(long)]
    pub accept_other_build: bool,
}

#[derive(Debug, Subcommand)]
pub enum BenchmarkCommand {
    /// Train and measure on the maps of RESCO in your copy of it: controllers, GS and DIALS, beside published figures
    Resco(RescoArgs),
}

#[derive(Debug, Args)]
pub struct RescoArgs {
    /// Your copy of RESCO's folder `environments`, with a folder per map; or the folder of one map
    pub dir: PathBuf,
    /// Rules of the lights and of SUMO
    #[arg(long, value_enum, default_value_t = RescoProtocol::Resco2021)]
    pub protocol: RescoProtocol,
    /// Maps, such as cologne1,ingolstadt7 [default: all that are there]
    #[arg(long, value_name = "MAP,...", value_delimiter = ',')]
    pub maps: Vec<String>,
    /// Seeds of training, such as 1..5 (five of them) or 1,2,7
    #[arg(long, value_name = "SEEDS", default_value = "1..5", value_parser = values::seeds)]
    pub seeds: Seeds,
    /// Ways to train: gs, gs-any-light, gs-shared, dials, dials-shared, or none for controllers alone
    #[arg(long, value_name = "METHOD,...", value_delimiter = ',', default_value = "gs,gs-any-light,gs-shared,dials,dials-shared",
          value_parser = ["gs", "gs-any-light", "gs-shared", "dials", "dials-shared", "none"])]
    pub methods: Vec<String>,
    /// Number of training episodes of a run
    #[arg(long, default_value_t = 100, value_parser = values::whole::<u64>(1..=100_000))]
    pub episodes: u64,
    /// Number of episodes that each controller and each last policy plays to be measured
    #[arg(long, value_name = "EPISODES", default_value_t = 10, value_parser = values::whole::<u32>(1..=1000))]
    pub measured_episodes: u32,
    /// Begin no further run after N minutes; runs that have begun go on to their end, and the page shows what there is
    #[arg(long, value_name = "N", value_parser = values::whole::<u64>(0..=A_YEAR_S / 60))]
    pub budget_minutes: Option<u64>,
    /// Number of cores to use [default: all]
    #[arg(long, value_parser = values::whole::<usize>(1..=MOST_WORKERS))]
    pub cores: Option<usize>,
    /// Folder for the runs and the page [default: resco/PROTOCOL-EPISODES]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Only list the runs and estimate time and memory; writes configs into the folder
    #[arg(long)]
    pub dry_run: bool,
    /// Resume runs although this program, SUMO, libm or the vector instructions have changed since
    #[arg(long)]
    pub accept_other_build: bool,
}

/// Rules of the lights and of SUMO in `benchmark resco`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RescoProtocol {
    /// RESCO's of 2021: decisions of 10 s with 3 s of yellow (arterial4x4: 5 s, 2 s), no teleports
    Resco2021,
    /// Ours for scenarios: decisions of 5 s, yellow and least greens of the light's program, SUMO's teleports
    Ours,
}

/// Seeds of runs, each once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seeds(pub Vec<u64>);

#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Run directories, directories of `baseline --csv` and of `plan`, or folders that contain them
    #[arg(required = true, value_name = "DIR")]
    pub folders: Vec<PathBuf>,
    /// Output folder for the page, its pictures and its tables
    #[arg(long, value_name = "DIR", default_value = "report")]
    pub out: PathBuf,
    /// Title of the page and of the slide, instead of the name of the scenario or config
    #[arg(long, value_name = "TEXT")]
    pub title: Option<String>,
    /// If the folder exists, move it aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct WatchArgs {
    /// Run directory, or a folder that contains some, such as that of an experiment
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Port on 127.0.0.1; 0: any free one
    #[arg(long, default_value_t = 0)]
    pub port: u16,
    /// Play no episodes for the map of delays, which runs on scenarios have
    #[arg(long)]
    pub no_map: bool,
}

#[derive(Debug, Args)]
#[command(after_help = STUCK)]
pub struct CompareArgs {
    /// Run directory, folder of runs or pattern such as 'runs/x-seed*'; separate several by commas
    pub a: String,
    /// The other side of the comparison, in the same form
    pub b: String,
    /// Return to reach, for the steps and time to it [default: the lower final return minus 5 % of its size]
    #[arg(long, value_name = "RETURN", value_parser = values::finite)]
    pub reach: Option<f64>,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
}
