//! What can be asked on the command line: types only.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

/// Multi-agent traffic-light control with distributed influence-augmented local simulators (DIALS) on SUMO.
///
/// Exit codes: 0 done, 1 the run failed, 2 asked wrongly, 130 interrupted.
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
    /// End when the process with this id does, which must be the one that started this one
    #[arg(long, global = true, hide = true, value_name = "PID")]
    pub end_with: Option<u32>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Train the policies of all agents and write a run directory
    Train(Train),
    /// Evaluate the policies of a run directory on the global simulator
    Evaluate(Evaluate),
    /// Write the policies of a run directory as a TorchScript module, for Python and C++
    Export(Export),
    /// Run a hand-coded controller on the global simulator of a config
    Baseline(Baseline),
    /// Measure how fast a config trains, phase by phase, beside what cannot be avoided
    Bench(Bench),
    /// Make all runs that a file names, over the cores of this machine; goes on where it was stopped
    Experiment(Experiment),
    /// Make curves, bars and tables of run directories, with the paper's numbers beside them
    Report(Report),
    /// Compare two groups of runs: final return with its interval, runtime, steps to reach a return
    Compare(Compare),
    /// Write an episode as a folder that plain `sumo` and `sumo-gui` play
    Replay(Replay),
    /// Write SUMO networks that `sumo` and `sumo-gui` open
    #[command(subcommand)]
    Nets(Nets),
    /// Tell versions and where each part was found
    Info,
    /// What `train` starts its worker processes with
    #[command(hide = true)]
    Worker,
}

#[derive(Debug, Args)]
pub struct Train {
    /// Config file, such as configs/smoke_traffic.toml
    #[arg(required_unless_present = "resume")]
    pub config: Option<PathBuf>,
    /// Go on with the run in this directory, from its newest checkpoint
    #[arg(long, value_name = "RUN_DIR",
          conflicts_with_all = ["config", "seed", "steps", "simulator", "tensorboard", "out", "settings", "force"])]
    pub resume: Option<PathBuf>,
    /// Go on although another build wrote the run, or SUMO, libm or vector instructions were others: its numbers may
    /// change. run.json records it
    #[arg(long, conflicts_with = "config")]
    pub accept_other_build: bool,
    /// Worker processes that share the agents; 0 works in this process. The results are the same
    /// [default: the number of cores]
    #[arg(long)]
    pub workers: Option<usize>,
    /// Seconds after which a worker that says nothing is started again
    #[arg(long, value_name = "SECONDS", default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..))]
    pub patience: u64,
    /// Root of all random streams; overrides the config
    #[arg(long)]
    pub seed: Option<u64>,
    /// Stop after so many timesteps per agent; learning rate and clip still decay over total_steps
    #[arg(long, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub steps: Option<u64>,
    /// What the policies train on; overrides the config
    #[arg(long, value_enum)]
    pub simulator: Option<Simulator>,
    /// Also write the numbers of the CSV files as an event file for TensorBoard
    #[arg(long)]
    pub tensorboard: bool,
    /// Run directory [default: runs/CONFIG-SIMULATOR-seedN, with a number where that exists]
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Override a key of the config, such as ppo.clip=0.2; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
    /// Move an existing run directory aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Simulator {
    /// Local simulators with AIPs that are trained every F steps
    Dials,
    /// The global simulator
    Gs,
    /// Local simulators with random AIPs that are never trained
    UntrainedDials,
    /// Local simulators with constant probabilities, measured on the global simulator, instead of AIPs
    MarginalDials,
}

#[derive(Debug, Args)]
pub struct Evaluate {
    /// Run directory, as `train` wrote it
    pub run_dir: PathBuf,
    #[command(flatten)]
    pub episodes: Episodes,
    /// Take the most probable action instead of drawing one
    #[arg(long)]
    pub greedy: bool,
    /// A hand-coded controller for all agents but those of --agents
    #[arg(long, value_name = "NAME", requires = "agents")]
    pub background: Option<String>,
    /// The agents that act by their policies, such as 0,3
    #[arg(long, value_name = "AGENT,...", value_delimiter = ',', requires = "background")]
    pub agents: Vec<usize>,
    #[command(flatten)]
    pub output: Output,
}

#[derive(Debug, Args)]
pub struct Export {
    /// Run directory, as `train` wrote it
    pub run_dir: PathBuf,
    /// File to write, such as policies.pt
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Overwrite the file where it exists
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct Baseline {
    /// Config file whose network and horizon are used
    pub config: PathBuf,
    /// A hand-coded controller; an unknown name lists them all
    #[arg(long, value_name = "NAME", required_unless_present = "compare", conflicts_with = "compare")]
    pub controller: Option<String>,
    /// Several controllers and run directories on the same traffic, and their differences to the first of them
    #[arg(long, value_name = "NAME,RUN_DIR,...", conflicts_with_all = ["render", "plot"])]
    pub compare: Option<String>,
    /// Let saved policies take the most probable action instead of drawing one
    #[arg(long, requires = "compare", conflicts_with = "controller")]
    pub greedy: bool,
    /// Look for the best timings of `fixed-time` first; they are kept under tuned/ and used again
    #[arg(long)]
    pub tune: bool,
    /// Episodes on which timings are compared
    #[arg(long, value_name = "EPISODES", default_value_t = 10, requires = "tune",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub tune_episodes: u32,
    #[command(flatten)]
    pub episodes: Episodes,
    #[command(flatten)]
    pub output: Output,
}

#[derive(Debug, Args)]
pub struct Bench {
    /// Config file, such as configs/traffic_100.toml
    pub config: PathBuf,
    /// Measure fleets of 1, 2, 4, ... and so many worker processes [default: the number of cores]
    #[arg(long)]
    pub workers: Option<NonZeroUsize>,
    /// About how long to measure each of them
    #[arg(long, value_name = "SECONDS", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub seconds: u64,
    /// What the policies train on; overrides the config
    #[arg(long, value_enum)]
    pub simulator: Option<Simulator>,
    /// Override a key of the config, such as local_simulators.copies=4; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Episodes {
    /// Episodes to play [default: evaluation.final_episodes of the config]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub episodes: Option<u32>,
    /// The same seed gives every controller and policy the same traffic [default: evaluation.seed of the config]
    #[arg(long)]
    pub seed: Option<u64>,
}

#[derive(Debug, Args)]
pub struct Output {
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
    /// Also write episodes.csv and agents.csv, a line per episode (and agent), into this directory
    #[arg(long, value_name = "DIR")]
    pub csv: Option<PathBuf>,
    /// Also write pictures of the first episode, one per step and an animation, into this directory (warehouse)
    #[arg(long, value_name = "DIR")]
    pub render: Option<PathBuf>,
    /// Also draw space and time, queues and signal timing of the first episode, and a map of the returns, as SVG files
    /// into this directory (traffic)
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct Replay {
    /// Run directory, as `train` wrote it; with --controller a config file
    #[arg(value_name = "RUN_DIR|CONFIG")]
    pub subject: PathBuf,
    /// Replay a hand-coded controller instead of the trained policies: the names of `baseline`
    #[arg(long, value_name = "NAME")]
    pub controller: Option<String>,
    /// Directory for the files
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// The first episode of `evaluate` and `baseline` with this --seed [default: evaluation.seed of the config]
    #[arg(long, value_name = "N")]
    pub episode_seed: Option<u64>,
    /// Replay the local simulator of this agent, with the cars that its AIP sends
    #[arg(long, value_name = "AGENT", conflicts_with = "controller")]
    pub local: Option<usize>,
    /// Take the most probable action instead of drawing one
    #[arg(long, conflicts_with = "controller")]
    pub greedy: bool,
    /// Open sumo-gui on it
    #[arg(long)]
    pub gui: bool,
    /// Make a film of it, a .gif or (with ffmpeg) an .mp4, without a screen
    #[arg(long, value_name = "FILE")]
    pub video: Option<PathBuf>,
    /// Move an existing directory or film aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct Experiment {
    /// File such as experiments/small_simulators_traffic.toml
    pub file: PathBuf,
    /// Folder for the run directories [default: results/FILE/runs]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Cores to use [default: all]
    #[arg(long, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=4096))]
    pub cores: Option<usize>,
    /// Only list the runs, with an estimate of time and memory
    #[arg(long)]
    pub dry_run: bool,
    /// Resume runs although another build wrote them, or SUMO, libm or vector instructions were others
    #[arg(long)]
    pub accept_other_build: bool,
}

#[derive(Debug, Args)]
pub struct Report {
    /// Run directories, or folders with run directories in them
    #[arg(required = true, value_name = "DIR")]
    pub folders: Vec<PathBuf>,
    /// Folder for the page, its pictures and its tables
    #[arg(long, value_name = "DIR", default_value = "report")]
    pub out: PathBuf,
    /// Move an existing folder aside instead of refusing
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct Compare {
    /// Run directory, folder of runs or pattern such as 'runs/x-seed*'; several with commas between
    pub a: String,
    /// What is compared with it, likewise
    pub b: String,
    /// Return to reach, for steps and time [default: 95 % of the worse final return]
    #[arg(long, value_name = "RETURN", value_parser = finite)]
    pub reach: Option<f64>,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
}

fn finite(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().map_err(|error| error.to_string())?;
    if number.is_finite() { Ok(number) } else { Err("must be a finite number".to_owned()) }
}

#[derive(Debug, Subcommand)]
pub enum Nets {
    /// A grid of R x C intersections with flows at its boundary
    Grid {
        #[arg(long)]
        rows: usize,
        #[arg(long)]
        cols: usize,
        /// Probability that a car arrives at a boundary edge in a step
        #[arg(long, default_value_t = 0.1)]
        inflow: f64,
        /// Directory for the files
        #[arg(long)]
        out: PathBuf,
    },
    /// The single intersection of the local simulators
    Local {
        /// Directory for the files
        #[arg(long)]
        out: PathBuf,
    },
}
