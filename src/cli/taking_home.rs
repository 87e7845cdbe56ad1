//! What leaves the program: `export` and `plan`.

use std::path::PathBuf;

use clap::Args;

use super::{EpisodesArgs, SettingsArgs, values};

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
