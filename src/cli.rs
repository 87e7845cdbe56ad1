//! The command line: only types and help texts. `values` reads the values of options.

mod networks;
mod playing;
mod runs;
mod taking_home;
mod training;
mod values;

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use clap_complete::Shell;

pub use networks::{DemandArgs, InspectArgs, NetsCommand};
pub use playing::{BaselineArgs, EpisodesArgs, EvaluateArgs, OutputArgs, ReplayArgs, VariantArgs};
pub use runs::{BenchmarkCommand, CompareArgs, ExperimentArgs, ReportArgs, RescoArgs, RescoProtocol, Seeds, WatchArgs};
pub use taking_home::{ExportArgs, PlanArgs};
pub use training::{BenchArgs, CheckArgs, DescribeArgs, SettingsArgs, TrainArgs};

/// Largest number of processes that may be asked for. More must be a typing error.
const MOST_WORKERS: u64 = 4096;
/// Largest number of rows and of columns: a grid has at most 10 000 intersections.
const MOST_ROWS: u64 = 10_000;
/// Longest patience in seconds.
const A_YEAR_S: u64 = 365 * 24 * 3600;
/// The definition in the glossary. A test compares them, and the limits with those of the domains.
pub const STUCK: &str = "A stuck light switches in over 75 % of green steps (grids); or greens last over 5 minutes on \
                         average, and cars wait over 4 (scenarios). A stuck robot collects under 0.5 items an episode.";

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
