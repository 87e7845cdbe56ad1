//! The roads of a file: a net, or the net that a scenario names.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};

use super::Roads;
use crate::outside::Printable;
use crate::traffic::network::contents::Content;
use crate::traffic::network::tree::{parse_file, read_whole};

/// Reads the roads of a `.net.xml`. An error names file, element, id and attribute.
pub fn read(net: &Path) -> Result<Roads> {
    let content = Content::read(net)?;
    Roads::read(&content.root).map_err(|error| anyhow!("{}: {error:#}", net.display()))
}

/// Returns the path of the net that a `.sumocfg` names. Paths in it are relative to its folder.
pub fn net_of_scenario(scenario: &Path) -> Result<PathBuf> {
    let root = parse_file(scenario, &read_whole(scenario)?)?;
    let place = scenario.display();
    ensure!(
        ["configuration", "sumoConfiguration"].contains(&root.name.as_str()),
        "{place}: is not a scenario of SUMO: its root is <{}>, not <configuration>",
        Printable(&root.name)
    );
    // SUMO takes an option at any depth, under its long or its short name.
    let sections = root.children.iter().flat_map(|section| section.children.iter().chain([section]));
    let named = sections.filter(|option| ["net-file", "net", "n"].contains(&option.name.as_str()));
    let value = named.filter_map(|option| option.attribute("value").or_else(|| option.attribute("v"))).next_back();
    let name = value.with_context(|| format!("{place}: names no <net-file value=\"...\"/> with the roads; add it"))?;
    Ok(scenario.parent().unwrap_or(Path::new("")).join(name))
}
