//! A scenario of the user: a .sumocfg and the files that it names, read once and checked.
//!
//! What was checked is what SUMO loads and what a run directory keeps. Nothing of it writes a file: outputs and
//! detectors are left out, and everything else by which SUMO would open another file is refused.
//!
//! - `elements`: which elements files may hold; `place`: names an element in an error.
//! - `net`: checks of the roads and lights; `streets`: the edges and where one comes from each.
//! - `demand`: checks of types, routes, vehicles and flows. [`dawdling`]: how much cars dawdle.
//! - [`kept`]: copies for run directories and replays; [`loadable`]: the scenario as SUMO of this process loads it.

pub mod dawdling;
mod demand;
mod elements;
pub mod kept;
pub mod loadable;
mod net;
mod place;
mod streets;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::network::contents::Content;
use super::network::roads::{EdgeNo, Roads};
use super::network::tree::Element;
use crate::config::ScenarioConfig;
use crate::config::sumocfg::Sumocfg;
use demand::{Demand, Departures};
use dials_core::outside::read_text;
use elements::Left;
use place::Place;
use streets::Streets;

/// Option of a .sumocfg that names the net.
const NET_FILE: &str = "net-file";
/// Option of a .sumocfg that names its demand.
const ROUTE_FILES: &str = "route-files";
/// Largest file of overrides.
const MOST_OVERRIDES: u64 = 1 << 20;

/// A scenario whose files were read. Clones share them.
#[derive(Clone, Debug)]
pub struct SumoScenario {
    /// The .sumocfg, as the user knows it.
    path: PathBuf,
    net: File,
    additional: Vec<File>,
    routes: Vec<File>,
    /// Text of the file of overrides and its path, if the config names one.
    agents: Option<(PathBuf, Arc<str>)>,
    /// Seconds at which an episode begins and ends.
    window_s: (u64, u64),
    /// Options of SUMO, without `--`.
    options: Vec<(String, String)>,
    left_out: Vec<String>,
    /// Where vehicles may depart.
    departures: Departures,
    /// Values of the config that decide what returns mean.
    rules: String,
}

/// A file of the scenario.
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
        let mut read = |option: &str, path: &PathBuf| -> Result<File> {
            ensure!(
                path.exists(),
                "{}: <{option}> names {}, and there is no such file; correct the path",
                config.scenario.display(),
                path.display()
            );
            let content = Content::read_cleaned(path, |root| elements::clean(option, path, root, &mut left))?;
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
        left_out.extend(left.told());
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
        let (departures, told) = scenario.check(&left)?;
        scenario.departures = departures;
        scenario.left_out.extend(told);
        scenario.left_out.extend(config.unplayed());
        Ok(scenario)
    }

    /// Checks what files say of each other. Returns where vehicles depart, and what will not be simulated.
    fn check(&self, left: &Left) -> Result<(Departures, Vec<String>)> {
        let in_files =
            self.additional.iter().flat_map(|file| file.content.root.all("tlLogic").map(move |light| (file, light)));
        let programs: Vec<Place<'_>> = in_files.map(|(file, light)| Place::new(&file.path, light)).collect();
        net::check(&self.net.path, self.net(), &programs)?;
        [&self.net]
            .into_iter()
            .chain(&self.additional)
            .try_for_each(|file| left.check_not_needed(&file.path, &file.content.root))?;
        let streets = Streets::of(&self.net.path, self.net())?;
        let mut demand = Demand::new(&streets, &self.options, self.window_s);
        for file in &self.additional {
            demand.read(&file.path, &file.content.root, demand::Order::Free)?;
        }
        for file in &self.routes {
            demand.read(&file.path, &file.content.root, demand::Order::Sorted)?;
        }
        demand.finish(&self.path)
    }

    /// Returns the path of the .sumocfg, as the user knows it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the root element of the net.
    pub fn net(&self) -> &Element {
        &self.net.content.root
    }

    /// Returns the path of the net, as the user knows it.
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

    /// Returns the root elements of the route files, in SUMO's order.
    pub fn routes(&self) -> impl Iterator<Item = &Element> {
        self.routes.iter().map(|file| &file.content.root)
    }

    /// Returns the file of overrides, its path and its text, if the config names one.
    pub fn agents(&self) -> Option<(&Path, &str)> {
        self.agents.as_ref().map(|(path, text)| (path.as_path(), &**text))
    }

    /// Returns the seconds at which an episode begins and ends.
    pub fn window_s(&self) -> (u64, u64) {
        self.window_s
    }

    /// Returns the options with which SUMO plays the scenario, without `--`.
    pub fn options(&self) -> &[(String, String)] {
        &self.options
    }

    /// Returns the roads on which vehicles of an episode may depart. `roads`: those of this scenario.
    pub fn departs_on(&self, roads: &Roads) -> BTreeSet<EdgeNo> {
        let named = self.departures.edges.iter().filter_map(|edge| roads.edge_named(edge));
        let at = |junction| self.departures.junctions.contains(&roads.junction(junction).id);
        let from_junctions = roads.roads().filter(|(_, edge)| edge.ends.is_some_and(|[begin, _]| at(begin)));
        named.chain(from_junctions.map(|(number, _)| number)).collect()
    }

    /// Lists what of the scenario will not be simulated, a sentence each.
    pub fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// Returns all files of the scenario but the .sumocfg. Strangers may have written them.
    pub fn files(&self) -> Vec<PathBuf> {
        self.all().map(|file| file.path.clone()).collect()
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

/// Reads the file of overrides. What it says is checked where it is understood.
fn overrides(path: &Path) -> Result<(PathBuf, Arc<str>)> {
    let text = read_text(path, MOST_OVERRIDES)
        .with_context(|| format!("{}: cannot be read; traffic.agents names it", path.display()))?;
    Ok((path.to_owned(), text.into()))
}

/// Returns the keys of the config that change what an agent may do or is paid for, as text.
fn rules(config: &ScenarioConfig) -> Result<String> {
    let ScenarioConfig { decision_s, min_green_s, yellow_s, approach_m, reward, .. } = config;
    Ok(serde_json::to_string(&(decision_s, min_green_s, yellow_s, approach_m, reward))?)
}
