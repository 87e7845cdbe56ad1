//! What trains and what asks about it: `train`, `check`, `bench`, `describe`, and the settings that all commands with a config take.

use std::path::PathBuf;

use clap::Args;

use super::{A_YEAR_S, MOST_WORKERS, values};

#[derive(Debug, Args)]
pub struct TrainArgs {
    /// Config file, such as configs/smoke_traffic.toml, or a .sumocfg
    #[arg(required_unless_present = "resume")]
    pub config: Option<PathBuf>,
    /// Resume the run in this directory from its newest checkpoint; with --steps also a run that has ended
    #[arg(long, value_name = "RUN_DIR",
          conflicts_with_all = ["config", "seed", "simulator", "tensorboard", "out", "settings", "begin", "end", "force"])]
    pub resume: Option<PathBuf>,
    /// Resume although this program, SUMO, libm or the vector instructions have changed since. Numbers may then change;
    /// run.json records it
    #[arg(long, conflicts_with = "config")]
    pub accept_other_build: bool,
    /// Number of worker processes that share the agents; 0: all work in this process. It does not change the results.
    /// Workers that would have neither agents nor episodes are not started [default: the number of cores; on a resume
    /// the earlier number]
    #[arg(long, value_parser = values::whole::<usize>(0..=MOST_WORKERS))]
    pub workers: Option<usize>,
    /// Under mpirun or srun: number of worker processes of every rank but rank 0, which coordinates [default: 1]
    #[arg(long, value_name = "N", value_parser = values::whole::<usize>(1..=MOST_WORKERS))]
    pub workers_per_rank: Option<usize>,
    /// Restart a worker that has been silent for N seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 600,
          value_parser = values::whole::<u64>(1..=A_YEAR_S))]
    pub patience: u64,
    /// Seed of all random numbers; overrides the config
    #[arg(long, value_parser = values::seed)]
    pub seed: Option<u64>,
    /// Stop after N timesteps per agent; learning rate and clip still decay over total_steps
    #[arg(long, value_parser = values::number_of_steps)]
    pub steps: Option<u64>,
    /// Simulator and predictor that the policies train with; overrides the config
    #[arg(long, value_parser = values::short_form())]
    pub simulator: Option<String>,
    /// Also write the numbers of the CSV files to a TensorBoard event file
    #[arg(long)]
    pub tensorboard: bool,
    /// Also show the run live, on a page for a browser on this machine; `watch` does this for any run
    #[arg(long)]
    pub dashboard: bool,
    /// Run directory [default: runs/[FOLDER-]CONFIG-SIMULATOR[-KEY=VALUE...]-seedN, numbered if it exists]
    #[arg(long)]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// If the run directory exists, move it aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Config file of traffic, or a .sumocfg
    pub config: PathBuf,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// Light to measure; can be repeated [default: all]
    #[arg(long = "light", value_name = "ID", allow_hyphen_values = true)]
    pub lights: Vec<String>,
    /// How much all cars of a scenario dawdle, from 0 to 1; with 0 nothing is random [default: as their types say]
    #[arg(long, value_name = "SIGMA", value_parser = values::sigma)]
    pub sigma: Option<f64>,
    /// Second of the episode from which cells are compared [default: 600, or a third of a shorter episode]
    #[arg(long, value_name = "SECOND", value_parser = values::whole::<usize>(0..=A_YEAR_S))]
    pub from: Option<usize>,
    /// Number of seconds that are compared [default: 1200, or as many as the episode has]
    #[arg(long, value_name = "SECONDS", value_parser = values::whole::<usize>(1..=A_YEAR_S))]
    pub seconds: Option<usize>,
    /// Seed of the greens and of SUMO
    #[arg(long, default_value_t = 0, value_parser = values::seed)]
    pub seed: u64,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Config file, such as configs/traffic_100.toml, or a .sumocfg
    pub config: PathBuf,
    /// Measure with 1, 2, 4, ... and N worker processes [default: the number of cores]
    #[arg(long, value_parser = values::whole::<usize>(1..=MOST_WORKERS))]
    pub workers: Option<usize>,
    /// Approximate measuring time for each number of workers; the command first prints how long the whole takes
    #[arg(long, value_name = "SECONDS", default_value_t = 20, value_parser = values::whole::<u64>(1..=86_400))]
    pub seconds: u64,
    /// Simulator and predictor that the policies train with; overrides the config
    #[arg(long, value_parser = values::short_form())]
    pub simulator: Option<String>,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct DescribeArgs {
    /// Config file, such as configs/traffic_4.toml, or a .sumocfg
    pub config: PathBuf,
    /// Number of worker processes to estimate time and memory for [default: the number of cores]
    #[arg(long, value_parser = values::whole::<usize>(1..=MOST_WORKERS))]
    pub workers: Option<usize>,
    /// Simulator and predictor that the policies train with; overrides the config
    #[arg(long, value_parser = values::short_form())]
    pub simulator: Option<String>,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// Print one JSON object instead of text, with all agents
    #[arg(long)]
    pub json: bool,
}

/// Changes to a config, wherever one is taken.
#[derive(Debug, Default, Args)]
pub struct SettingsArgs {
    /// Override a key of the config, such as ppo.clip=0.2; can be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
    /// Second at which an episode of a scenario begins, such as 25200 or 07:00:00; sets traffic.begin_s
    #[arg(long, value_name = "TIME", value_parser = values::time)]
    pub begin: Option<u64>,
    /// Second at which an episode of a scenario ends; sets traffic.end_s
    #[arg(long, value_name = "TIME", value_parser = values::time)]
    pub end: Option<u64>,
    /// Program (programID) to use for lights that have several; sets traffic.program
    #[arg(long, value_name = "ID")]
    pub program: Option<String>,
}

impl SettingsArgs {
    /// Returns all of them as `KEY=VALUE`.
    pub fn all(&self) -> Vec<String> {
        let begin = self.begin.map(|second| format!("traffic.begin_s={second}"));
        let end = self.end.map(|second| format!("traffic.end_s={second}"));
        // As a string of TOML, because a name may be a number.
        let program = self.program.as_ref().map(|name| format!("traffic.program={}", toml::Value::from(&**name)));
        self.settings.iter().cloned().chain(begin).chain(end).chain(program).collect()
    }
}
