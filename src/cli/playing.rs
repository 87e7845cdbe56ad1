//! What plays episodes: `evaluate`, `baseline`, `replay`, and what of it is written or drawn.

use std::ops::Range;
use std::path::PathBuf;

use clap::Args;

use super::{STUCK, SettingsArgs, values};

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
