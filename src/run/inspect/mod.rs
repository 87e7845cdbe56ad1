//! `nets inspect`: what becomes of the lights of a network, before anything is simulated.
//!
//! - `text`: for people; `json`: for programs; `map`: the picture of `--plot`.

mod json;
mod map;
mod text;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};

use super::outputs;
use super::places::{self, Existing};
use crate::error::{Error, Result as CommandResult};
use crate::outside::read_text;
use crate::terminal::{self, answer, tell};
use crate::traffic::agents::derive::overrides::Overrides;
use crate::traffic::agents::derive::padding::Padding;
use crate::traffic::agents::derive::{Derived, Rules, derive};
use crate::traffic::network::roads::file::net_of_scenario;
use crate::traffic::network::roads::{Roads, file};

/// Largest file of overrides, in bytes.
const MOST_OVERRIDES: u64 = 1 << 20;

/// Everything that is shown of a network.
struct Inspected {
    net: PathBuf,
    roads: Roads,
    derived: Derived,
    padding: Padding,
    rules: Rules,
}

pub fn inspect(path: &Path, agents: Option<&Path>, as_json: bool, plot: Option<&Path>) -> CommandResult<()> {
    let inspected = prepared(path, agents, plot).map_err(Error::Usage)?;
    let written = if as_json {
        answer(terminal::json(serde_json::to_string_pretty(&json::described(&inspected)).expect("JSON has any text")))
    } else {
        answer(text::described(&inspected).trim_end())
    };
    written.and_then(|()| plot.map_or(Ok(()), |dir| draw(&inspected, dir))).map_err(Error::Run)
}

fn prepared(path: &Path, agents: Option<&Path>, plot: Option<&Path>) -> Result<Inspected> {
    plot.map_or(Ok(()), |dir| outputs::check_free(dir, "--plot"))?;
    let net = net_of(path)?;
    let roads = file::read(&net)?;
    let overrides = agents.map_or(Ok(Overrides::default()), read_overrides)?;
    let rules = Rules::default();
    let derived = derive(&roads, &rules, &overrides).map_err(|error| anyhow!("{}: {error:#}", net.display()))?;
    let padding = Padding::of(derived.agents.iter().map(|agent| &agent.plan));
    Ok(Inspected { net: net.into_owned(), roads, derived, padding, rules })
}

/// Returns the net of the file that a person named: a scenario or a net.
fn net_of(path: &Path) -> Result<Cow<'_, Path>> {
    let is_scenario = path.extension().is_some_and(|extension| extension == "sumocfg");
    if is_scenario { net_of_scenario(path).map(Cow::Owned) } else { Ok(Cow::Borrowed(path)) }
}

fn read_overrides(path: &Path) -> Result<Overrides> {
    let text = read_text(path, MOST_OVERRIDES).with_context(|| format!("{}: could not be read", path.display()))?;
    Overrides::parse(&text).map_err(|error| anyhow!("{}: {error:#}", path.display()))
}

fn draw(inspected: &Inspected, dir: &Path) -> Result<()> {
    const NAME: &str = "regions.svg";
    let svg = map::drawn(inspected)?;
    places::make(dir, Existing::Refuse, |staged| staged.put(NAME, svg.file().as_bytes()))?;
    tell(format_args!("drew {NAME} into {}", dir.display()));
    Ok(())
}
