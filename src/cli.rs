//! The command line: only types and help texts. `values` reads the values of options.

mod values;

use std::ops::Range;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;

/// Largest number of processes that may be asked for. More must be a typing error.
const MOST_WORKERS: u64 = 4096;
/// Largest number of rows and of columns: a grid has at most 10 000 intersections.
const MOST_ROWS: u64 = 10_000;
/// Longest patience in seconds.
const A_YEAR_S: u64 = 365 * 24 * 3600;
/// The definition in the glossary. A test compares them, and the limits with those of the domains.
pub const STUCK: &str = "An agent is stuck if its light switches in over 75 % of green steps (grids), or its greens last \
                         over 5 minutes on average (scenarios), or its robot collects under 0.5 items an episode.";

/// Multi-agent traffic-light control with distributed influence-augmented local simulators (DIALS) on SUMO.
///
/// Exit codes: 0 done, 1 the run failed or another process is writing it, 2 usage error, 130 interrupted.
#[derive(Debug, Parser)]
#[command(
    name = "dials-traffic",
    version,
    about,
    long_about,
    subcommand_required = true,
    arg_required_else_help = true
)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// Print only errors, warnings and results
    #[arg(long, short, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Also print what the work is doing
    #[arg(long, short, global = true)]
    pub verbose: bool,
    /// End when the process with this id ends; it must be the parent of this one
    #[arg(long, global = true, hide = true, value_name = "PID")]
    pub end_with: Option<u32>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Train the policies of all agents and write a run directory
    Train(TrainArgs),
    /// Evaluate the policies of a run directory on the global simulator
    Evaluate(EvaluateArgs),
    /// Write the policies of a run directory as a TorchScript module, for Python and C++, or as one policy for any light
    Export(ExportArgs),
    /// Run a hand-coded controller on the global simulator of a config
    Baseline(BaselineArgs),
    /// Write a plan of all lights that plain `sumo` loads: timings of a controller, or the ones that fit a trained run best
    Plan(PlanArgs),
    /// Measure how closely the local simulator of each light matches the global one
    Check(CheckArgs),
    /// Measure training speed, phase by phase, against a lower bound
    Bench(BenchArgs),
    /// Run all experiments of a file in parallel; resumes where it stopped
    Experiment(ExperimentArgs),
    /// Run a benchmark that others report, and write our figures beside theirs
    #[command(subcommand)]
    Benchmark(BenchmarkCommand),
    /// Draw curves, bars and tables of run directories, next to the paper's numbers
    Report(ReportArgs),
    /// Watch runs while they train, on a page for a browser on this machine
    Watch(WatchArgs),
    /// Compare two groups of runs: final return with its interval, runtime, steps to a return
    Compare(CompareArgs),
    /// Write an episode as a folder that plain `sumo` and `sumo-gui` can play
    Replay(ReplayArgs),
    /// Show what a config is about: agents, observations, actions, reward, and what a run will do and cost
    Describe(DescribeArgs),
    /// Write SUMO networks that `sumo` and `sumo-gui` can open
    #[command(subcommand)]
    Nets(NetsCommand),
    /// Make vehicles whose routes fit traffic counts, as a scenario
    Demand(DemandArgs),
    /// Print versions and where each part was found
    Info,
    /// Check whether training works here; print what is missing and the command that installs it
    Doctor,
    /// Print completions of the command line for a shell
    Completions {
        /// Shell that will read them
        shell: Shell,
    },
    /// Write a manual page for the program and for each subcommand
    Man {
        /// Output directory
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// If the directory exists, move it aside instead of refusing
        #[arg(long)]
        force: bool,
    },
    /// Print the JSON schema of a config, for editors
    Schema,
    /// A worker process; `train` starts it
    #[command(hide = true)]
    Worker,
    /// A process that holds one simulator; a worker starts it
    #[command(hide = true)]
    Simulator,
    /// Tries the files of a config in their simulator; this program starts it
    #[command(hide = true)]
    TryOut,
    /// A process that plays for the map of a run's delays; `watch` starts it
    #[command(hide = true)]
    MapPlayer { run: PathBuf },
}

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
#[command(after_help = STUCK)]
pub struct EvaluateArgs {
    /// Run directory written by `train`; with --on a policy for any light, which `export` wrote
    pub run_dir: PathBuf,
    /// Play a policy for any light on the lights of this config file or .sumocfg
    #[arg(long, value_name = "CONFIG", conflicts_with_all = ["background", "agents"])]
    pub on: Option<PathBuf>,
    #[command(flatten)]
    pub episodes: EpisodesArgs,
    /// Take the most probable action instead of sampling
    #[arg(long)]
    pub greedy: bool,
    /// Hand-coded controller for all agents except those of --agents
    #[arg(long, value_name = "NAME", requires = "agents")]
    pub background: Option<String>,
    /// Agents that use their trained policies, by number or name, such as 0,3 or r0c0,r1c1
    #[arg(long, value_name = "AGENT,...", allow_hyphen_values = true, value_delimiter = ',', requires = "background")]
    pub agents: Vec<String>,
    #[command(flatten)]
    pub variants: VariantArgs,
    #[command(flatten)]
    pub output: OutputArgs,
}

#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Run directory written by `train`
    pub run_dir: PathBuf,
    /// Output file, such as policies.pt; one per kind of agents (policies.KIND.pt) if there are several. A name that ends in
    /// .safetensors gets a policy for any light
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// If the file exists, move it aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
#[command(after_help = STUCK)]
pub struct BaselineArgs {
    /// Config file, or a .sumocfg; its network and horizon are used
    pub config: PathBuf,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// Hand-coded controller; an unknown name lists all names
    #[arg(long, value_name = "NAME", required_unless_present = "compare", conflicts_with = "compare")]
    pub controller: Option<String>,
    /// Compare controllers and run directories on the same traffic; the first one is the reference
    #[arg(long, value_name = "NAME,RUN_DIR,...", conflicts_with_all = ["render", "plot"])]
    pub compare: Option<String>,
    /// Saved policies take the most probable action instead of sampling
    #[arg(long, requires = "compare", conflicts_with = "controller")]
    pub greedy: bool,
    /// First search the best timings for `fixed-time` and `coordinated`, on episodes of the config's seed; they are cached
    /// in tuned/
    #[arg(long)]
    pub tune: bool,
    /// Number of episodes per timing in the search
    #[arg(long, value_name = "EPISODES", default_value_t = 10, requires = "tune",
          value_parser = values::whole::<u32>(1..=10_000))]
    pub tune_episodes: u32,
    #[command(flatten)]
    pub episodes: EpisodesArgs,
    #[command(flatten)]
    pub variants: VariantArgs,
    #[command(flatten)]
    pub output: OutputArgs,
}

#[derive(Debug, Args)]
pub struct PlanArgs {
    /// A .sumocfg, a config file, or a run directory, whose policies are then frozen
    #[arg(value_name = "SCENARIO|RUN_DIR")]
    pub config: PathBuf,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// `fixed-time`, `webster` or `coordinated`, with their parameters; or a run directory or another rule, whose greens
    /// are watched and frozen [default: the run directory, if one was named]
    #[arg(long, value_name = "NAME|RUN_DIR")]
    pub controller: Option<String>,
    /// Search for better timings, from those of the controller on
    #[arg(long, conflicts_with = "actuated")]
    pub tune: bool,
    /// Number of episodes per timing in the search
    #[arg(long, value_name = "EPISODES", default_value_t = 10, requires = "tune",
          value_parser = values::whole::<u32>(1..=10_000))]
    pub tune_episodes: u32,
    /// Write actuated programs of SUMO: each green between the lengths below which 5 and 95 % of the watched greens are
    #[arg(long)]
    pub actuated: bool,
    /// Number of episodes in which greens are watched
    #[arg(long, value_name = "EPISODES", default_value_t = 5, value_parser = values::whole::<u32>(1..=10_000))]
    pub watch_episodes: u32,
    /// Saved policies take the most probable action instead of sampling
    #[arg(long)]
    pub greedy: bool,
    #[command(flatten)]
    pub episodes: EpisodesArgs,
    /// Output directory, for programs.add.xml, plan.csv, plan.html, and what `report` reads
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
    /// If the directory exists, move it aside instead of refusing
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

#[derive(Clone, Debug, Args)]
pub struct EpisodesArgs {
    /// Number of episodes [default: evaluation.final_episodes of the config]
    #[arg(long, value_parser = values::whole::<u32>(1..=100_000))]
    pub episodes: Option<u32>,
    /// Seed of the traffic, the same for every controller and policy [default: evaluation.seed of the config]
    #[arg(long, value_parser = values::seed)]
    pub seed: Option<u64>,
}

/// Other traffic on the same scenario. Every demand is played with all edges open, and with each closure.
#[derive(Clone, Debug, Args)]
pub struct VariantArgs {
    /// Play with these multiples of the scenario's demand, such as 0.8,1,1.2
    #[arg(long, value_name = "FACTOR,...", value_delimiter = ',', value_parser = values::demand)]
    pub demand: Vec<f64>,
    /// Also play with this edge closed for all vehicles; can be repeated. Edges separated by commas are closed together
    #[arg(long, value_name = "EDGE[,EDGE...]", allow_hyphen_values = true)]
    pub closed: Vec<String>,
}

#[derive(Clone, Debug, Args)]
pub struct OutputArgs {
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
    /// Also write episodes.csv and agents.csv into this directory; for traffic also lights.csv and city.json, from which `report`
    /// makes a page
    #[arg(long, value_name = "DIR")]
    pub csv: Option<PathBuf>,
    /// Also print the lights where cars lose the most time: delay per car, stops, queue and level of service (traffic). --compare
    /// prints them anyway, and --json and --csv have all lights
    #[arg(long)]
    pub per_light: bool,
    /// Without the figures of lights, which cost time; experiments do not read them
    #[arg(long, hide = true, conflicts_with = "per_light")]
    pub without_lights: bool,
    /// Also measure CO2 and fuel by the emission classes of the vehicles, SUMO's HBEFA (traffic). It takes CPU time
    #[arg(long)]
    pub emissions: bool,
    /// Also draw the first episode, one picture per step and an animation, into this directory (warehouse)
    #[arg(long, value_name = "DIR")]
    pub render: Option<PathBuf>,
    /// Also draw time-space diagrams, queues and signal timing of the first episode and a map of the returns, as SVG
    /// files, into this directory (traffic)
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
    /// On a scenario: edges that follow each other, along which --plot draws the time-space diagram [default: the route
    /// of a car on which lights meet the most cars]
    #[arg(long, value_name = "EDGE,EDGE,...", requires = "plot", allow_hyphen_values = true)]
    pub route: Option<String>,
    /// Seconds of the first episode that --plot shows, such as 600,1200 [default: all]
    #[arg(long, value_name = "FROM,TO", requires = "plot", value_parser = values::seconds)]
    pub seconds: Option<Range<usize>>,
    /// Also write what signal controllers with loops in the road would log, for tools such as PyPI's `atspm`, with a
    /// table of the detectors and one of the phases beside it (traffic)
    #[arg(long, value_name = "FILE.csv")]
    pub events: Option<PathBuf>,
    /// If an output of --csv, --render, --plot or --events exists, move it aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// Run directory written by `train`; with --controller a config file or a .sumocfg
    #[arg(value_name = "RUN_DIR|CONFIG")]
    pub subject: PathBuf,
    /// Replay a hand-coded controller of `baseline` instead of the trained policies
    #[arg(long, value_name = "NAME")]
    pub controller: Option<String>,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// Output directory
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Replay the first episode of `evaluate` or `baseline` with this --seed [default: evaluation.seed of the config]
    #[arg(long, value_name = "N", value_parser = values::seed)]
    pub episode_seed: Option<u64>,
    /// Replay the local simulator of this agent, by number or name, with the cars that its influence predictor sends
    #[arg(long, value_name = "AGENT", conflicts_with = "controller", allow_hyphen_values = true)]
    pub local: Option<String>,
    /// Take the most probable action instead of sampling
    #[arg(long, conflicts_with = "controller")]
    pub greedy: bool,
    /// Open the replay in sumo-gui
    #[arg(long)]
    pub gui: bool,
    /// Film the replay as a .gif or (with ffmpeg) an .mp4; needs no screen
    #[arg(long, value_name = "FILE")]
    pub video: Option<PathBuf>,
    /// Also draw a time-space diagram, queues and signal timing of the episode, as SVG files, into this directory
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
    /// Seconds of the episode that --video and --plot show, such as 600,1200 [default: all]
    #[arg(long, value_name = "FROM,TO", value_parser = values::seconds)]
    pub seconds: Option<Range<usize>>,
    /// Also write what signal controllers with loops in the road would log, as `evaluate --events` does
    #[arg(long, value_name = "FILE.csv", conflicts_with = "local")]
    pub events: Option<PathBuf>,
    /// If a directory, the film or the log exists, move it aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

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
    /// Ways to train: gs, gs-shared, dials, dials-shared, or none for controllers alone
    #[arg(long, value_name = "METHOD,...", value_delimiter = ',', default_value = "gs,gs-shared,dials,dials-shared",
          value_parser = ["gs", "gs-shared", "dials", "dials-shared", "none"])]
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

#[derive(Debug, Subcommand)]
pub enum NetsCommand {
    /// Write a grid of R x C intersections with traffic flowing in at its boundary
    Grid {
        /// Number of rows of intersections
        #[arg(long, value_parser = values::whole::<usize>(1..=MOST_ROWS))]
        rows: usize,
        /// Number of columns of intersections
        #[arg(long, value_parser = values::whole::<usize>(1..=MOST_ROWS))]
        cols: usize,
        /// Probability that a car arrives at a boundary edge in a step
        #[arg(long, default_value_t = 0.1, value_parser = values::number)]
        inflow: f64,
        /// Probability at one dead end, instead of `--inflow`: `--inflow-at w1=0.3`; may be given several times. Dead
        /// ends are `w0` (west end of row 0), `s0`, `e0`, `n0` and so on
        #[arg(long, value_name = "DEAD_END=P", value_parser = values::inflow_at)]
        inflow_at: Vec<(String, f64)>,
        /// Output directory
        #[arg(long)]
        out: PathBuf,
        /// If one of the files exists and differs, move it aside instead of refusing
        #[arg(long)]
        force: bool,
    },
    /// Cut the surroundings of one light out of a SUMO network, as a network of its own with some cars
    Cut {
        /// Scenario of SUMO
        #[arg(value_name = "FILE.sumocfg")]
        file: PathBuf,
        #[command(flatten)]
        settings: SettingsArgs,
        /// Light to cut out
        #[arg(long, value_name = "ID", allow_hyphen_values = true)]
        light: String,
        /// Number of edges in a row that are kept behind each exit; none of them begins more than 150 m behind it
        #[arg(long, default_value_t = 3, value_parser = values::whole::<u8>(0..=5))]
        hops: u8,
        /// Output directory
        #[arg(long)]
        out: PathBuf,
        /// If one of the files exists and differs, move it aside instead of refusing
        #[arg(long)]
        force: bool,
    },
    /// List the lights of a SUMO network: which ones learn, and which ones keep their program
    Inspect(InspectArgs),
    /// Write the single intersection of the local simulators
    Local {
        /// Output directory
        #[arg(long)]
        out: PathBuf,
        /// If one of the files exists and differs, move it aside instead of refusing
        #[arg(long)]
        force: bool,
    },
}

#[derive(Debug, Args)]
pub struct DemandArgs {
    /// Counts: a CSV file with the columns begin, end, from, to and cars; docs/counts.md
    #[arg(value_name = "COUNTS.csv")]
    pub counts: PathBuf,
    /// Net of SUMO, or a scenario, whose net is taken
    #[arg(value_name = "FILE.net.xml|FILE.sumocfg")]
    pub net: PathBuf,
    /// Output directory for demand.rou.xml and demand.sumocfg
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Print one JSON object instead of text, with all counts
    #[arg(long)]
    pub json: bool,
    /// If one of the files exists, move it aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct InspectArgs {
    /// Scenario or net of SUMO
    #[arg(value_name = "FILE.sumocfg|FILE.net.xml")]
    pub file: PathBuf,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// Show this light in full: greens, yellows, approaches, exits, observation columns
    #[arg(long, value_name = "ID", conflicts_with_all = ["all", "json"], allow_hyphen_values = true)]
    pub light: Option<String>,
    /// Show all lights in full
    #[arg(long, conflicts_with = "json")]
    pub all: bool,
    /// File that changes some lights; docs/networks.md says how
    #[arg(long, value_name = "AGENTS_TOML")]
    pub agents: Option<PathBuf>,
    /// Print one JSON object instead of text, with all lights in full
    #[arg(long)]
    pub json: bool,
    /// Draw a map of the lights and their regions into this directory
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
    /// If the directory of --plot exists, move it aside instead of refusing
    #[arg(long, requires = "plot")]
    pub force: bool,
}
