//! What can be asked on the command line: types only.

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
    /// Traffic: random, never, always, switch-every-K, actuated (SUMO's) or gap-out; warehouse: random,
    /// closest-item or oldest-item
    #[arg(long, value_name = "NAME")]
    pub controller: String,
    #[command(flatten)]
    pub episodes: Episodes,
    #[command(flatten)]
    pub output: Output,
}

#[derive(Debug, Args)]
pub struct Episodes {
    /// Episodes to play [default: evaluation.episodes of the config]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub episodes: Option<u32>,
    /// The same seed gives every controller and policy the same traffic [default: seed of the config]
    #[arg(long)]
    pub seed: Option<u64>,
}

#[derive(Debug, Args)]
pub struct Output {
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
    /// Also write pictures of the first episode, one per step and an animation, into this directory (warehouse)
    #[arg(long, value_name = "DIR")]
    pub render: Option<PathBuf>,
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
