//! A scenario of the user: a .sumocfg and the files that it names, read once. SUMO judges whether they are right, in a
//! process of its own. Only what this program reads itself, and what SUMO would take in silence, is checked here.
//!
//! What was read is what SUMO loads and what a run directory keeps. Nothing of it writes a file: outputs and
//! detectors are left out, and everything else by which SUMO would open another file is refused.

pub(crate) mod dawdling;
mod demand;
mod elements;
pub(crate) mod end;
pub(crate) mod kept;
mod newer;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::network::contents::Content;
use super::network::loadable::Loadable;
use super::network::roads::{EdgeNo, Roads};
use super::network::tree::Element;
use crate::config::ScenarioConfig;
use crate::config::sumocfg::Sumocfg;
use demand::{Demand, Departures, Order};
use dials_core::outside::{excerpt, quoted, read_text};
use elements::Left;

const NET_FILE: &str = "net-file";
const ROUTE_FILES: &str = "route-files";
const MOST_OVERRIDES: u64 = 1 << 20;

#[derive(Clone, Debug)]
pub struct SumoScenario {
    path: PathBuf,
    net: File,
    additional: Vec<File>,
    routes: Vec<File>,
    /// Text of the file of overrides and its path, if the config names one.
    agents: Option<(PathBuf, Arc<str>)>,
    window_s: (u64, u64),
    options: Vec<(String, String)>,
    left_out: Vec<String>,
    departures: Departures,
    /// Values of the config that decide what returns mean.
    rules: String,
}

#[derive(Clone, Debug)]
struct File {
    path: PathBuf,
    content: Arc<Content>,
}

impl SumoScenario {
    /// Reads and checks the scenario that a config names. An error names the file, the element and the way out.
    pub fn read(config: &ScenarioConfig) -> Result<SumoScenario> {
        let sumocfg = Sumocfg::read(&config.scenario)?;
        let mut left = Left::default();
        let here = || libsumo::load().ok().map(|sumo| sumo.version);
        let mut newer = Vec::new();
        let mut read = |option: &str, path: &PathBuf| -> Result<File> {
            ensure!(
                path.exists(),
                "{}: <{option}> names {}, and there is no such file; correct the path",
                config.scenario.display(),
                path.display()
            );
            let content = Content::read_cleaned(path, |root| {
                let note = if root.name == "net" { newer::forget_classes(root, here) } else { None };
                let forgets = note.is_some();
                newer.extend(note.map(|note| format!("{}: {note}", path.display())));
                Ok(elements::clean(option, path, root, &mut left)? || forgets)
            })?;
            ensure!(
                option == NET_FILE || content.root.name != "net",
                "{}: is a net, and <{option}> of {} names it; correct the path",
                path.display(),
                config.scenario.display()
            );
            Ok(File { path: path.clone(), content: Arc::new(content) })
        };
        let net = read(NET_FILE, &sumocfg.net)?;
        let additional = sumocfg.additional.iter().map(|path| read("additional-files", path)).collect::<Result<_>>()?;
        let routes = sumocfg.routes.iter().map(|path| read(ROUTE_FILES, path)).collect::<Result<_>>()?;
        let mut left_out = sumocfg.left_out;
        left_out.extend(newer);
        left_out.extend(left.sentences());
        let mut scenario = SumoScenario {
            path: config.scenario.clone(),
            net,
            additional,
            routes,
            agents: config.agents.as_deref().map(overrides).transpose()?,
            window_s: config.window_s()?,
            options: sumocfg.options,
            left_out,
            departures: Departures::default(),
            rules: rules(config)?,
        };
        let (departures, notes) = scenario.check(&left)?;
        scenario.departures = departures;
        scenario.left_out.extend(notes);
        scenario.left_out.extend(config.about_the_end());
        scenario.left_out.extend(config.unplayed());
        Ok(scenario)
    }

    /// Checks what SUMO does not. Returns where vehicles depart, and what will not be simulated.
    fn check(&self, left: &Left) -> Result<(Departures, Vec<String>)> {
        let (net, file) = (self.net(), self.net.path.display());
        ensure!(net.name == "net", "{file}: is no net of SUMO: its root is <{}>, not <net>", excerpt(&net.name));
        ensure!(
            net.all("tlLogic").chain(self.additional().flat_map(|root| root.all("tlLogic"))).next().is_some(),
            "{file}: has no traffic light (<tlLogic>); make some with: netconvert -s {file} --tls.set JUNCTION,... -o \
             NEW.net.xml"
        );
        // Cars that never cross a junction need none.
        let has_connections = net.all("connection").next().is_some();
        ensure!(
            !has_connections || net.all("edge").any(|edge| edge.attribute("function") == Some("internal")),
            "{file}: has no internal lanes, so cars would jump over intersections; make the net without \
             --no-internal-links"
        );
        [&self.net]
            .into_iter()
            .chain(&self.additional)
            .try_for_each(|file| left.check_not_needed(&file.path, &file.content.root))?;
        let mut demand = Demand::new(self.window_s);
        for file in &self.additional {
            demand.read(&file.path, &file.content.root, Order::Free)?;
        }
        for file in &self.routes {
            demand.read(&file.path, &file.content.root, Order::Sorted)?;
        }
        let (departures, mut notes) = demand.finish(&self.path)?;
        let is_on = |value: &str| ["true", "1", "yes", "on", "t", "x"].contains(&value);
        if self.option("ignore-route-errors").is_some_and(is_on) {
            notes.push(
                "cars that have no way: SUMO goes on with them (ignore-route-errors); such a car stands at the end of a \
                 road and blocks the lane until it is moved (time-to-teleport)"
                    .to_owned(),
            );
        }
        Ok((departures, notes))
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn net(&self) -> &Element {
        &self.net.content.root
    }

    pub fn net_path(&self) -> &Path {
        &self.net.path
    }

    /// Returns the roads, with the programs and offsets of the additional files after the net's.
    pub fn roads(&self) -> Result<Roads> {
        let mut roads = Roads::read(self.net()).with_context(|| self.net.path.display().to_string())?;
        for file in &self.additional {
            for program in file.content.root.all("tlLogic") {
                roads.load_program(program).with_context(|| file.path.display().to_string())?;
            }
        }
        Ok(roads)
    }

    /// Returns the root elements of the additional files, in SUMO's order.
    pub fn additional(&self) -> impl Iterator<Item = &Element> {
        self.additional.iter().map(|file| &file.content.root)
    }

    pub fn routes(&self) -> impl Iterator<Item = &Element> {
        self.routes.iter().map(|file| &file.content.root)
    }

    pub(crate) fn agents(&self) -> Option<(&Path, &str)> {
        self.agents.as_ref().map(|(path, text)| (path.as_path(), &**text))
    }

    pub fn window_s(&self) -> (u64, u64) {
        self.window_s
    }

    /// Returns the options with which SUMO plays the scenario, without `--`.
    pub(crate) fn options(&self) -> &[(String, String)] {
        &self.options
    }

    fn option(&self, name: &str) -> Option<&str> {
        self.options.iter().find(|(key, _)| key == name).map(|(_, value)| &**value)
    }

    /// Returns the roads on which vehicles of an episode may depart. `roads`: those of this scenario.
    pub fn departs_on(&self, roads: &Roads) -> BTreeSet<EdgeNo> {
        let named = self.departures.edges.iter().filter_map(|edge| roads.edge_named(edge));
        let at = |junction| self.departures.junctions.contains(&roads.junction(junction).id);
        let from_junctions = roads.roads().filter(|(_, edge)| edge.ends.is_some_and(|[begin, _]| at(begin)));
        named.chain(from_junctions.map(|(number, _)| number)).collect()
    }

    /// Returns the message about a scenario that SUMO cannot load, with the way out.
    pub(crate) fn cannot_be_simulated(&self) -> String {
        let newer = libsumo::load().ok().and_then(|sumo| newer::way_out(self.net(), sumo.version));
        let way_out = newer.unwrap_or_else(|| format!("try it with: sumo -c {}", quoted(&self.path)));
        format!("{}: SUMO cannot simulate this scenario; {way_out}", self.path.display())
    }

    pub fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// Puts the scenario where SUMO of this process can load it, with a file of actuated programs of this name.
    pub fn for_sumo(&self, actuated: &str, program: &str) -> Result<Loadable> {
        let texts = |files: &'_ [File]| -> Vec<(String, PathBuf)> {
            files.iter().map(|file| (file.content.text(), file.path.clone())).collect()
        };
        let net = self.net.content.text();
        let (begin, end) = self.window_s;
        let time = [("begin", begin.to_string()), ("end", end.to_string()), ("step-length", "1".to_owned())];
        let actuated = (actuated, Path::new("ACTUATED-PROGRAMS"));
        let loadable =
            Loadable::new(program, (&net, &self.net.path), &texts(&self.routes), &texts(&self.additional), actuated)?;
        Ok(loadable.with(time).with(self.options.iter().cloned()))
    }

    /// Returns the CRC-32 of everything that decides what returns mean: the files as SUMO loads them, times, options,
    /// the overrides and the config's rules for the lights. A copy has the same.
    pub fn checksum(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        let mut add = |text: &str| {
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        };
        self.all().for_each(|file| add(&file.content.text()));
        add(&format!("{:?} {:?}", self.window_s, self.options));
        add(self.agents().map_or("", |(_, text)| text));
        add(&self.rules);
        hasher.finalize()
    }

    fn all(&self) -> impl Iterator<Item = &File> {
        [&self.net].into_iter().chain(&self.additional).chain(&self.routes)
    }
}

fn overrides(path: &Path) -> Result<(PathBuf, Arc<str>)> {
    let text = read_text(path, MOST_OVERRIDES)
        .with_context(|| format!("{}: cannot be read; traffic.agents names it", path.display()))?;
    Ok((path.to_owned(), text.into()))
}

/// Returns the keys of the config that change what an agent may do or is rewarded for, as text.
fn rules(config: &ScenarioConfig) -> Result<String> {
    let ScenarioConfig { decision_s, min_green_s, yellow_s, approach_m, reward, .. } = config;
    Ok(serde_json::to_string(&(decision_s, min_green_s, yellow_s, approach_m, reward))?)
}
