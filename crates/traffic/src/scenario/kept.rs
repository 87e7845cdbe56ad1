//! Copies of a scenario: plain names, and a .sumocfg that `sumo -c` and `sumo-gui -c` open. A run directory keeps one,
//! and a replay plays one.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::departing::FLOWS;
use super::{File, SumoScenario};
use crate::network::tree::Element;
use crate::network::xml::{self, document, section};
use dials_core::outside::write_together;

/// Beginning of the names in the copy of a run directory.
pub(crate) const KEPT: &str = "scenario";
const AGENTS: &str = "agents.toml";

pub(crate) struct Episode<'a> {
    pub(crate) seed: u32,
    pub(crate) end_s: u64,
    /// Name of the file with further programs of the lights, in the same folder.
    pub(crate) signals: &'a str,
    /// Further programs that SUMO takes in the net only.
    pub(crate) net_programs: Vec<Element>,
    /// Name of the file with the settings of sumo-gui, in the same folder.
    pub(crate) view: &'a str,
}

impl SumoScenario {
    /// Makes a folder and copies the scenario into it, all or nothing. Returns the paths of the config's keys.
    pub fn keep_in(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        fs::create_dir(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        let mut files = self.copied(KEPT, None, |file| file.content.bytes.clone());
        let mut kept = vec![PathBuf::from(format!("{KEPT}.sumocfg"))];
        if let Some((_, text)) = self.agents() {
            files.push((AGENTS.to_owned(), text.as_bytes().to_vec()));
            kept.push(PathBuf::from(AGENTS));
        }
        kept.extend(self.keep_drawn(folder)?);
        let files: Vec<_> = files.into_iter().map(|(name, bytes)| (folder.join(name), bytes)).collect();
        write_together(folder, &files)?;
        Ok(kept)
    }

    /// Returns the files of a folder in which plain SUMO plays an episode: names, which begin with `name`, and contents.
    pub(crate) fn episode_files(&self, name: &str, episode: &Episode<'_>) -> Vec<(String, Vec<u8>)> {
        self.copied(name, Some(episode), |file| {
            match file.content.root.name == "net" && !episode.net_programs.is_empty() {
                true => with_programs(&file.content.root, &episode.net_programs),
                false => self.with_ends_of_flows(file),
            }
        })
    }

    /// Returns copies of all files: names, which begin with `name`, and contents.
    fn copied(
        &self,
        name: &str,
        episode: Option<&Episode<'_>>,
        content: impl Fn(&File) -> Vec<u8>,
    ) -> Vec<(String, Vec<u8>)> {
        let numbered = |files: &[File], ending: &str| -> Vec<String> {
            (1..=files.len()).map(|number| format!("{name}.{number}.{ending}.xml")).collect()
        };
        let net = format!("{name}.net.xml");
        let (routes, additional) = (numbered(&self.routes, "rou"), numbered(&self.additional, "add"));
        let names = [&net].into_iter().chain(&routes).chain(&additional);
        let files = [&self.net].into_iter().chain(&self.routes).chain(&self.additional);
        let mut copies: Vec<_> = names.zip(files).map(|(name, file)| (name.clone(), content(file))).collect();
        let sumocfg = self.sumocfg(&net, &routes, &additional, episode);
        copies.push((format!("{name}.sumocfg"), sumocfg.into_bytes()));
        copies
    }

    /// Returns a copy in which every flow without an end has that of the scenario, so that an episode may end earlier.
    fn with_ends_of_flows(&self, file: &File) -> Vec<u8> {
        const RATES: [&str; 6] =
            ["period", "vehsPerHour", "perHour", "personsPerHour", "containersPerHour", "probability"];
        let is_spread = |child: &Element| {
            let has = |key: &str| child.attribute(key).is_some();
            FLOWS.contains(&&*child.name) && has("number") && !has("end") && !RATES.into_iter().any(has)
        };
        if !file.content.root.children.iter().any(is_spread) {
            return file.content.bytes.clone();
        }
        let mut root = file.content.root.clone();
        for flow in root.children.iter_mut().filter(|child| is_spread(child)) {
            flow.attributes.push(("end".to_owned(), self.window_s.1.to_string()));
        }
        xml::text(&root).into_bytes()
    }

    fn sumocfg(&self, net: &str, routes: &[String], additional: &[String], episode: Option<&Episode<'_>>) -> String {
        let routes = routes.join(",");
        let signals = episode.map(|episode| episode.signals.to_owned());
        let additional = additional.iter().cloned().chain(signals).collect::<Vec<_>>().join(",");
        let mut input = vec![("net-file", net), ("route-files", &routes), ("additional-files", &additional)];
        input.retain(|(_, files)| !files.is_empty());
        let (begin, end) = self.window_s;
        let end = episode.map_or(end, |episode| episode.end_s);
        let [begin, end] = [begin, end].map(|second| second.to_string());
        let step = self.step_length();
        let options: Vec<(&str, &str)> = self.options.iter().map(|(name, value)| (&**name, &**value)).collect();
        document("configuration", |xml| {
            section(xml, "input", &input)?;
            section(xml, "time", &[("begin", &begin), ("end", &end), (step.0, &step.1)])?;
            section(xml, "processing", &options)?;
            // Without it, SUMO warns of a missing SUMO_HOME, where it would look for the schemas.
            let validation = ("xml-validation", "never");
            let Some(episode) = episode else { return section(xml, "report", &[validation]) };
            section(xml, "random_number", &[("seed", &episode.seed.to_string())])?;
            section(xml, "report", &[("no-warnings", "true"), validation])?;
            section(xml, "gui_only", &[("gui-settings-file", episode.view)])
        })
    }
}

/// Returns a net with further programs behind its own.
fn with_programs(net: &Element, programs: &[Element]) -> Vec<u8> {
    let mut root = net.clone();
    let last = root.children.iter().rposition(|child| child.name == "tlLogic").map_or(0, |last| last + 1);
    root.children.splice(last..last, programs.iter().cloned());
    xml::text(&root).into_bytes()
}
