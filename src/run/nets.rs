//! `nets`: writes SUMO networks, cuts them, and inspects them.

use std::path::Path;

use super::inspect::inspect;
use super::outputs::check_not_of_a_run;
use crate::cli::NetsCommand;
use crate::config::ScenarioConfig;
use crate::error::{Error, Result};
use crate::outside::quoted;
use crate::terminal::answer;
use crate::traffic::agents::derive::Rules;
use crate::traffic::cut::beyond::Reach;
use crate::traffic::cut::of_scenario::{cut_light, write};
use crate::traffic::network::files::NetworkFiles;
use crate::traffic::paper_grid::grid::Grid;
use crate::traffic::paper_grid::make::{write_grid, write_local};
use crate::traffic::scenario::SumoScenario;

pub fn nets(args: &NetsCommand) -> Result<()> {
    if let NetsCommand::Grid { out, .. } | NetsCommand::Cut { out, .. } | NetsCommand::Local { out } = args {
        check_not_of_a_run("--out", out).map_err(Error::Usage)?;
    }
    let written = match args {
        NetsCommand::Grid { rows, cols, inflow, out } => {
            Grid::new(*rows, *cols).and_then(|grid| write_grid(grid, *inflow, out))
        }
        NetsCommand::Local { out } => write_local(out),
        NetsCommand::Cut { file, light, hops, out } => cut(file, light, usize::from(*hops), out),
        NetsCommand::Inspect { file, agents, json, plot, force } => {
            return inspect(file, agents.as_deref(), *json, plot.as_deref(), *force);
        }
    };
    let files = written.map_err(Error::Usage)?;
    let (net, config) = (files.net.display(), quoted(&files.config));
    answer(format_args!("wrote {net}\nwatch it with: sumo-gui -c {config}")).map_err(Error::Run)
}

fn cut(file: &Path, light: &str, hops: usize, out: &Path) -> anyhow::Result<NetworkFiles> {
    let scenario = SumoScenario::read(&ScenarioConfig::of_file(file)?)?;
    let net = cut_light(&scenario, light, Rules::default().approach_m, Reach { hops, ..Reach::default() })?;
    write(&net, &scenario, out)
}
