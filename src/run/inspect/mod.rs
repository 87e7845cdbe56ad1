//! `nets inspect`: what becomes of the lights of a network, before anything is simulated.
//!
//! - `text`: for people; `json`: for programs; `map`: the picture of `--plot`.

mod json;
mod map;
mod text;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};

use super::outputs;
use super::places::{self, Existing};
use crate::config::ScenarioConfig;
use crate::error::{Error, Result as CommandResult};
use crate::outside::read_text;
use crate::terminal::{self, answer, tell};
use crate::traffic::agents::derive::overrides::Overrides;
use crate::traffic::agents::derive::padding::Padding;
use crate::traffic::agents::derive::{Derived, Rules, derive};
use crate::traffic::network::roads::{Roads, file};
use crate::traffic::scenario::SumoScenario;

/// Largest file of overrides, in bytes.
const MOST_OVERRIDES: u64 = 1 << 20;

/// Everything that is shown of a network.
struct Inspected {
    net: PathBuf,
    roads: Roads,
    derived: Derived,
    padding: Padding,
    rules: Rules,
    /// What of the scenario is not simulated, a sentence each.
    left_out: Vec<String>,
}

pub fn inspect(
    path: &Path,
    agents: Option<&Path>,
    as_json: bool,
    plot: Option<&Path>,
    force: bool,
) -> CommandResult<()> {
    let existing = Existing::of_named(force);
    let inspected = prepared(path, agents, plot, existing).map_err(Error::Usage)?;
    let written = if as_json {
        answer(terminal::json(serde_json::to_string_pretty(&json::described(&inspected)).expect("JSON has any text")))
    } else {
        answer(text::described(&inspected).trim_end())
    };
    written.and_then(|()| plot.map_or(Ok(()), |dir| draw(&inspected, dir, existing))).map_err(Error::Run)
}

fn prepared(path: &Path, agents: Option<&Path>, plot: Option<&Path>, existing: Existing) -> Result<Inspected> {
    plot.map_or(Ok(()), |dir| outputs::check_free(dir, "--plot", existing))?;
    let (net, roads, left_out) = match path.extension().is_some_and(|extension| extension == "sumocfg") {
        true => of_scenario(path)?,
        false => (path.to_owned(), file::read(path)?, Vec::new()),
    };
    let overrides = agents.map_or(Ok(Overrides::default()), read_overrides)?;
    let rules = Rules::default();
    let derived = derive(&roads, &rules, &overrides).map_err(|error| anyhow!("{}: {error:#}", net.display()))?;
    let padding = Padding::of(derived.agents.iter().map(|agent| &agent.plan));
    Ok(Inspected { net, roads, derived, padding, rules, left_out })
}

/// Reads a scenario whole. Returns its net, the roads of it, and what of the scenario is not simulated.
fn of_scenario(path: &Path) -> Result<(PathBuf, Roads, Vec<String>)> {
    let config = ScenarioConfig::of_file(path)?;
    let scenario = SumoScenario::read(&config)?;
    let roads = scenario.roads()?;
    Ok((scenario.net_path().to_owned(), roads, scenario.left_out().to_vec()))
}

fn read_overrides(path: &Path) -> Result<Overrides> {
    let text = read_text(path, MOST_OVERRIDES).with_context(|| format!("{}: could not be read", path.display()))?;
    Overrides::parse(&text).map_err(|error| anyhow!("{}: {error:#}", path.display()))
}

fn draw(inspected: &Inspected, dir: &Path, existing: Existing) -> Result<()> {
    const NAME: &str = "regions.svg";
    let svg = map::drawn(inspected)?;
    places::make(dir, existing, |staged| staged.put(NAME, svg.file().as_bytes()))?;
    tell(format_args!("drew {NAME} into {}", dir.display()));
    Ok(())
}
