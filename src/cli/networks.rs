//! Networks and demand: `nets` and `demand`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::{MOST_ROWS, SettingsArgs, values};

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
