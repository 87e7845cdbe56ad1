//! `nets`: writes SUMO networks, cuts them, and inspects them.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use super::inspect::inspect;
use crate::cli::NetsCommand;
use dials_core::base::repeated;
use dials_core::outside::{quoted, temporary_dir, write_together};
use dials_session::config::load;
use dials_session::domains::DomainConfig;
use dials_session::error::{Error, Result as CommandResult};
use dials_session::outputs::{check_free, check_not_of_a_run};
use dials_session::places::{Existing, clear};
use dials_session::terminal::answer;
use dials_traffic::agents::derive::Rules;
use dials_traffic::config::{ScenarioConfig, TrafficTable};
use dials_traffic::cut::beyond::Reach;
use dials_traffic::cut::of_scenario::{cut_light, write};
use dials_traffic::network::files::NetworkFiles;
use dials_traffic::paper_grid::grid::Grid;
use dials_traffic::paper_grid::inflow::Inflow;
use dials_traffic::paper_grid::make::{write_grid, write_local};
use dials_traffic::scenario::SumoScenario;

pub(super) fn nets(args: &NetsCommand) -> CommandResult<()> {
    let written = match args {
        NetsCommand::Grid { rows, cols, inflow, inflow_at, out, force } => Grid::new(*rows, *cols).and_then(|grid| {
            let dead_ends: Vec<&str> = inflow_at.iter().map(|(dead_end, _)| &**dead_end).collect();
            if let Some(dead_end) = repeated(&dead_ends) {
                bail!("--inflow-at: {dead_end} is given twice; leave one");
            }
            let inflow = Inflow::from(*inflow).with(inflow_at.iter().cloned());
            put(out, *force, &format!("grid_{grid}"), |room| write_grid(grid, inflow, room))
        }),
        NetsCommand::Local { out, force } => put(out, *force, "local", write_local),
        NetsCommand::Cut { file, settings, light, hops, out, force } => {
            put(out, *force, "cut", |room| cut(file, &settings.all(), light, usize::from(*hops), room))
        }
        NetsCommand::Inspect(args) => return inspect(args),
    };
    let files = written.map_err(Error::Usage)?;
    let (net, config) = (files.net.display(), quoted(&files.config));
    answer(format_args!("wrote {net}\nwatch it with: sumo-gui -c {config}")).map_err(Error::Run)
}

/// Reads a .sumocfg as a config, with settings laid over it.
pub(super) fn scenario_with(file: &Path, settings: &[String]) -> Result<ScenarioConfig> {
    // Its errors are about the scenario, and not about a config.
    if settings.is_empty() {
        return ScenarioConfig::of_file(file);
    }
    match load(file, settings)?.domain {
        Some(DomainConfig::Traffic(TrafficTable::Scenario(scenario))) => Ok(scenario),
        _ => bail!("{}: is no scenario with these settings; leave --set out", file.display()),
    }
}

fn cut(file: &Path, settings: &[String], light: &str, hops: usize, out: &Path) -> Result<NetworkFiles> {
    let scenario = SumoScenario::read(&scenario_with(file, settings)?)?;
    let net = cut_light(&scenario, light, Rules::default().approach_m, Reach { hops, ..Reach::default() })?;
    write(&net, &scenario, out)
}

/// Puts the files of a network into a directory. A directory may hold several networks, so only files of the same names
/// are in the way. Those that stay as they are, are not.
///
/// `name`: name of the network. `make`: makes its files in a directory, so that an error changes nothing in `out`.
fn put(out: &Path, force: bool, name: &str, make: impl FnOnce(&Path) -> Result<NetworkFiles>) -> Result<NetworkFiles> {
    check_not_of_a_run("--out", out)?;
    let files = NetworkFiles::of(&out.join(name));
    files.check_config_path()?;
    let room = temporary_dir()?;
    make(room.path())?;
    let mut new: Vec<(PathBuf, Vec<u8>)> = Vec::new();
    for entry in fs::read_dir(room.path())? {
        let entry = entry?;
        let (place, bytes) = (out.join(entry.file_name()), fs::read(entry.path())?);
        let as_long = place.metadata().is_ok_and(|there| there.is_file() && there.len() == bytes.len() as u64);
        if !(as_long && fs::read(&place).is_ok_and(|there| there == bytes)) {
            new.push((place, bytes));
        }
    }
    let existing = Existing::of_named(force);
    new.iter().try_for_each(|(place, _)| check_free(place, "--out", existing))?;
    new.iter().try_for_each(|(place, _)| clear(place, existing))?;
    write_together(out, &new)?;
    Ok(files)
}
