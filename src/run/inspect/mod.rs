//! `nets inspect`: what becomes of the lights of a network, before anything is simulated.
//!
//! - `text`: for people; `json`: for programs; `map`: the picture of `--plot`.

mod json;
mod map;
mod text;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};

use super::outputs;
use super::places::{self, Existing};
use crate::config::ScenarioConfig;
use crate::error::{Error, Result as CommandResult};
use crate::outside::read_text;
use crate::terminal::{self, answer, tell};
use crate::traffic::agents::derive::border::Seconds;
use crate::traffic::agents::derive::overrides::Overrides;
use crate::traffic::agents::derive::padding::{InfluencePadding, Padding};
use crate::traffic::agents::derive::{Derived, Rules, derive};
use crate::traffic::agents::plan::Border;
use crate::traffic::network::roads::{EdgeNo, Roads, file};
use crate::traffic::scenario::SumoScenario;

/// Largest file of overrides, in bytes.
const MOST_OVERRIDES: u64 = 1 << 20;

/// Everything that is shown of a network.
struct Inspected {
    net: PathBuf,
    roads: Roads,
    derived: Derived,
    padding: Padding,
    /// Borders of the agents' regions, in their order.
    borders: Vec<Border>,
    influence: InfluencePadding,
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
    let Subject { net, roads, departs_on, seconds, left_out } =
        match path.extension().is_some_and(|extension| extension == "sumocfg") {
            true => of_scenario(path)?,
            false => of_net(path)?,
        };
    let overrides = agents.map_or(Ok(Overrides::default()), read_overrides)?;
    let rules = Rules::default();
    let derived = derive(&roads, &rules, &overrides).map_err(|error| anyhow!("{}: {error:#}", net.display()))?;
    let padding = Padding::of(derived.agents.iter().map(|agent| &agent.plan));
    let borders = derived.borders(&roads, &departs_on, rules.approach_m, seconds);
    let influence = InfluencePadding::of(borders.iter());
    Ok(Inspected { net, roads, derived, padding, borders, influence, rules, left_out })
}

/// What is inspected.
struct Subject {
    net: PathBuf,
    roads: Roads,
    /// Roads on which cars depart.
    departs_on: BTreeSet<EdgeNo>,
    seconds: Seconds,
    left_out: Vec<String>,
}

/// Reads a scenario whole.
fn of_scenario(path: &Path) -> Result<Subject> {
    let config = ScenarioConfig::of_file(path)?;
    let scenario = SumoScenario::read(&config)?;
    let roads = scenario.roads()?;
    Ok(Subject {
        net: scenario.net_path().to_owned(),
        departs_on: scenario.departs_on(&roads),
        roads,
        seconds: Seconds::of(&config),
        left_out: scenario.left_out().to_vec(),
    })
}

/// Reads a net alone. Nobody departs there, and an episode would be an hour of decisions of the usual length.
fn of_net(path: &Path) -> Result<Subject> {
    let decision = ScenarioConfig::new(path).decision_s as usize;
    Ok(Subject {
        net: path.to_owned(),
        roads: file::read(path)?,
        departs_on: BTreeSet::new(),
        seconds: Seconds { decision, episode: 3600 },
        left_out: Vec::new(),
    })
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
