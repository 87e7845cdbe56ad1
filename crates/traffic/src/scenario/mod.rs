//! A scenario of the user: a .sumocfg and the files that it names, read once. SUMO judges whether they are right, in a
//! process of its own. Only what this program reads itself, and what SUMO would take in silence, is checked here.
//!
//! What was read is what SUMO loads and what a run directory keeps. Nothing of it writes a file: outputs and
//! detectors are left out, and everything else by which SUMO would open another file is refused.

pub mod closing;
pub(crate) mod dawdling;
mod demand;
mod departing;
mod devices;
mod drawn;
mod elements;
pub(crate) mod end;
mod include;
pub(crate) mod kept;
mod locally;
mod newer;
mod origin;
pub(crate) mod own_types;
pub(crate) mod programs;
mod reading;
pub(crate) mod stops;
pub(crate) mod travellers;
pub(crate) mod ways;

use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail, ensure};

use super::network::contents::Content;
use super::network::loadable::Loadable;
use super::network::roads::{EdgeNo, Roads};
use super::network::tree::Element;
use super::network::xml;
use crate::agents::derive::crossings::Walking;
use crate::agents::derive::overrides::Overrides;
use crate::config::sumocfg::{Notes, Sumocfg};
use crate::config::{Actions, ScenarioConfig};
use closing::{Closed, Detours};
use demand::{Demand, Departures, Order};
use dials_core::outside::{excerpt, quoted, read_text};
use drawn::Drawn;
use programs::{Choice, Chosen};
use reading::Files;

const MOST_OVERRIDES: u64 = 1 << 20;

/// Option that says how many vehicles SUMO makes of each one.
const SCALE: &str = "scale";

#[derive(Clone, Debug)]
pub struct SumoScenario {
    path: PathBuf,
    net: File,
    additional: Vec<File>,
    routes: Vec<File>,
    /// Route files of which each episode plays one, if the config names some. Then there are no others.
    drawn: Option<Arc<Drawn>>,
    /// Whether its route file is one of those.
    plays_drawn: bool,
    /// Text of the file of overrides and its path, if the config names one.
    agents: Option<(PathBuf, Arc<str>)>,
    window_s: (u64, u64),
    steps_per_s: u32,
    /// Whether greens last at least as long as programs say.
    keeps_min_dur: bool,
    options: Vec<(String, String)>,
    notes: Notes,
    departures: Departures,
    chosen: Chosen,
    /// Values of the config that decide what returns mean.
    rules: String,
    /// Factor by which there are more vehicles than the files and the option `scale` say.
    demand: f64,
    /// Ids of closed edges, and the files that SUMO gets with them.
    closed: Vec<String>,
    without_closed: Option<Arc<Closed>>,
    /// How people on foot cross, if the config says that it counts.
    walking: Option<Walking>,
    actions: Actions,
}

#[derive(Clone, Debug)]
struct File {
    path: PathBuf,
    content: Arc<Content>,
}

impl SumoScenario {
    /// Reads and checks the scenario that a config names. An error names the file, the element and the way out.
    pub fn read(config: &ScenarioConfig) -> Result<SumoScenario> {
        let mut sumocfg = Sumocfg::read(&config.scenario)?;
        let drawn = config.route_files()?;
        if !drawn.is_empty() {
            sumocfg.routes.clear();
        }
        let agents = config.agents.as_deref().map(overrides).transpose()?;
        let parsed = agents.as_ref().map_or(Ok(Overrides::default()), |(path, text)| parsed(path, text))?;
        let programs = Choice::of(config.program.clone(), &parsed);
        let Files { net, additional, routes, left_out, chosen } = Files::read(&config.scenario, &sumocfg, &programs)?;
        let mut notes = sumocfg.notes;
        notes.left_out.extend(left_out);
        let mut scenario = SumoScenario {
            path: config.scenario.clone(),
            net,
            additional,
            routes,
            drawn: None,
            plays_drawn: false,
            agents,
            window_s: config.window_s()?,
            steps_per_s: sumocfg.steps_per_s,
            keeps_min_dur: config.program_min_green,
            options: sumocfg.options,
            notes,
            departures: Departures::default(),
            chosen,
            rules: rules(config)?,
            demand: config.demand,
            closed: config.closed.clone(),
            without_closed: None,
            walking: config.walking(),
            actions: config.actions,
        };
        scenario.check_net()?;
        scenario.notes.left_out.extend(config.about_the_end());
        scenario.notes.left_out.extend(config.unplayed());
        scenario.notes.not_local.extend(config.cannot_be_local());
        if !drawn.is_empty() {
            return scenario.with_drawn(&drawn, None);
        }
        let (departures, notes) = scenario.check_demand()?;
        scenario.departures = departures;
        scenario.notes.extend(notes);
        scenario.notes.extend(locally::notes(&scenario));
        if !scenario.closed.is_empty() {
            let closed = scenario.close_edges()?;
            scenario.notes.left_out.push(scenario.about_detours(&closed.detours));
            scenario.without_closed = Some(Arc::new(closed));
        }
        Ok(scenario)
    }

    fn check_net(&self) -> Result<()> {
        let (net, file) = (self.net(), self.net.path.display());
        ensure!(net.name == "net", "{file}: is no net of SUMO: its root is <{}>, not <net>", excerpt(&net.name));
        ensure!(
            self.lights().next().is_some(),
            "{file}: has no traffic light (<tlLogic>); make some with: netconvert -s {file} --tls.set JUNCTION,... -o \
             NEW.net.xml"
        );
        Ok(())
    }

    /// Checks what SUMO does not. Returns where vehicles depart, and what will not be simulated.
    fn check_demand(&self) -> Result<(Departures, Notes)> {
        let mut demand = Demand::new(self.window_s, self.scale());
        for file in &self.additional {
            demand.read(&file.path, &file.content.root, Order::Free)?;
        }
        for file in &self.routes {
            demand.read(&file.path, &file.content.root, Order::Sorted)?;
        }
        let (departures, mut notes) = demand.finish(&self.path)?;
        let is_on = |value: &str| ["true", "1", "yes", "on", "t", "x"].contains(&value);
        if self.option("ignore-route-errors").is_some_and(is_on) {
            notes.left_out.push(
                "cars that have no way: SUMO goes on with them (ignore-route-errors); such a car stands at the end of a \
                 road and blocks the lane until it is moved (time-to-teleport)"
                    .to_owned(),
            );
        }
        Ok((departures, notes))
    }

    fn close_edges(&self) -> Result<Closed> {
        let (begin, end) = self.window_s;
        let files = closing::Files {
            net: self.net(),
            additional: self.additional().collect(),
            routes: self.routes().collect(),
            window_s: (begin as f64, end as f64),
        };
        closing::close(&files, &self.roads()?, &self.closed)
            .with_context(|| format!("{}: traffic.closed", self.net.path.display()))
    }

    /// Checks that the net has roads of these ids.
    pub(crate) fn check_edges(&self, ids: &[String]) -> Result<()> {
        let roads = self.roads()?;
        ids.iter()
            .try_for_each(|id| roads.edge_called(id).map(drop))
            .with_context(|| self.net.path.display().to_string())
    }

    /// Returns the street of each of these edges; `None` for one whose street the net does not name.
    pub(crate) fn streets_of(&self, ids: &[String]) -> Result<Vec<Option<String>>> {
        if ids.is_empty() {
            return Ok(Vec::new());
        }
        let roads = self.roads()?;
        ids.iter().map(|id| Ok(roads.edge(roads.edge_called(id)?).street.clone())).collect()
    }

    /// Returns what becomes of vehicles because of closed edges. `None`: all edges are open.
    pub(crate) fn detours(&self) -> Option<Detours> {
        match &self.drawn {
            Some(drawn) => drawn.detours,
            None => Some(self.without_closed.as_ref()?.detours),
        }
    }

    fn about_detours(&self, detours: &Detours) -> String {
        format!("closed {}: {detours}", self.closed.join(", "))
    }

    fn lights(&self) -> impl Iterator<Item = &Element> {
        [self.net()].into_iter().chain(self.additional()).flat_map(|root| root.all("tlLogic"))
    }

    /// Returns an error with all reasons why there can be no local simulators, if there are some.
    pub(crate) fn check_local(&self) -> Result<()> {
        if self.notes.not_local.is_empty() {
            return Ok(());
        }
        bail!(
            "{}: has no local simulators:\n  {}\n  train on the whole network (--simulator gs), or change that",
            self.path.display(),
            self.notes.not_local.join("\n  ")
        )
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
        let roots = [self.net()].into_iter().chain(self.additional());
        let switched =
            roots.flat_map(|root| root.all("wautJunction")).filter_map(|light| light.attribute("junctionID"));
        roads.switched = switched.map(str::to_owned).collect();
        Ok(roads)
    }

    /// Returns the root elements of the additional files, in SUMO's order.
    pub fn additional(&self) -> impl Iterator<Item = &Element> {
        self.additional.iter().map(|file| &file.content.root)
    }

    /// Returns the root elements of the route files that all episodes play.
    pub fn routes(&self) -> impl Iterator<Item = &Element> {
        self.routes.iter().map(|file| &file.content.root)
    }

    fn agents(&self) -> Option<(&Path, &str)> {
        self.agents.as_ref().map(|(path, text)| (path.as_path(), &**text))
    }

    pub(crate) fn overrides(&self) -> Result<Overrides> {
        self.agents().map_or(Ok(Overrides::default()), |(path, text)| parsed(path, text))
    }

    pub fn window_s(&self) -> (u64, u64) {
        self.window_s
    }

    pub(crate) fn chosen(&self) -> &Chosen {
        &self.chosen
    }

    /// Returns the options with which SUMO plays the scenario, without `--`.
    pub(crate) fn options(&self) -> &[(String, String)] {
        &self.options
    }

    fn option(&self, name: &str) -> Option<&str> {
        self.options.iter().find(|(key, _)| key == name).map(|(_, value)| &**value)
    }

    /// Returns how many vehicles SUMO makes of each one of the files.
    fn scale(&self) -> f64 {
        self.option(SCALE).and_then(|scale| scale.parse().ok()).unwrap_or(1.0) * self.demand
    }

    /// Returns the roads on which vehicles of an episode may depart. `roads`: those of this scenario.
    pub fn departs_on(&self, roads: &Roads) -> BTreeSet<EdgeNo> {
        let named = self.departures.edges.iter().filter_map(|edge| roads.edge_named(edge));
        let at = |junction| self.departures.junctions.contains(&roads.junction(junction).id);
        let from_junctions = roads.roads().filter(|(_, edge)| edge.ends.is_some_and(|[begin, _]| at(begin)));
        named.chain(from_junctions.map(|(number, _)| number)).collect()
    }

    /// Returns the error of an episode without a vehicle, if at least one must have entered.
    pub(crate) fn check_not_empty(&self) -> Result<()> {
        let (begin, end) = self.window_s;
        ensure!(
            self.departures.at_least < 1.0,
            "{}: not one vehicle entered from {begin} to {end} s, but at least {} should have: so all returns would be those of \
             empty roads; see whether SUMO refuses their departSpeed or departPos, or a number of their types or an option \
             such as max-num-vehicles keeps them out: sumo -c {}",
            self.path.display(),
            self.departures.at_least,
            quoted(&self.path)
        );
        Ok(())
    }

    /// Returns the message about a scenario that SUMO cannot load, with the way out.
    pub(crate) fn cannot_be_simulated(&self) -> String {
        let newer = libsumo::load().ok().and_then(|sumo| newer::way_out(self.net(), sumo.version));
        let routes = self.routes.first().filter(|_| self.plays_drawn);
        let routes = routes.map_or(String::new(), |file| format!(" -r {}", quoted(&file.path)));
        let way_out = newer.unwrap_or_else(|| format!("try it with: sumo -c {}{routes}", quoted(&self.path)));
        format!("{}: SUMO cannot simulate this scenario; {way_out}", self.path.display())
    }

    pub fn notes(&self) -> &Notes {
        &self.notes
    }

    /// Returns SUMO's steps in a second.
    pub(crate) fn steps_per_s(&self) -> u32 {
        self.steps_per_s
    }

    /// Returns the option that says how long a step of SUMO is, without `--`.
    pub(crate) fn step_length(&self) -> (&'static str, String) {
        ("step-length", (1.0 / f64::from(self.steps_per_s)).to_string())
    }

    /// Puts the scenario where SUMO of this process can load it, with a file of actuated programs of this name.
    pub fn for_sumo(&self, actuated: &str, program: &str) -> Result<Loadable> {
        let closed = self.without_closed.as_deref();
        let texts = |files: &'_ [File], closed: Option<&[Element]>| -> Vec<(String, PathBuf)> {
            let text = |(number, file): (usize, &File)| match closed {
                Some(closed) => (xml::text(&closed[number]), file.path.clone()),
                None => (file.content.text(), file.path.clone()),
            };
            files.iter().enumerate().map(text).collect()
        };
        let routes = texts(&self.routes, closed.map(|closed| &*closed.routes));
        let additional = texts(&self.additional, closed.map(|closed| &*closed.additional));
        let net = closed.map_or_else(|| self.net.content.text(), |closed| xml::text(&closed.net));
        let (begin, end) = self.window_s;
        let time = [("begin", begin.to_string()), ("end", end.to_string()), self.step_length()];
        let actuated = (actuated, Path::new("ACTUATED-PROGRAMS"));
        let loadable = Loadable::new(program, (&net, &self.net.path), &routes, &additional, actuated)?;
        let loadable =
            loadable.of_scenario(&self.path).with_steps_per_s(self.steps_per_s).with_devices(self.may_have_devices());
        // Without a factor SUMO gets the option as the .sumocfg has it.
        let is_scaled = self.demand != 1.0;
        let options = self.options.iter().filter(|(name, _)| !(is_scaled && name == SCALE)).cloned();
        let scale = is_scaled.then(|| (SCALE.to_owned(), self.scale().to_string()));
        Ok(loadable.with(time).with(options.chain(scale)))
    }

    /// Returns whether vehicles may have devices, such as one that finds new ways.
    pub(crate) fn may_have_devices(&self) -> bool {
        match &self.drawn {
            Some(drawn) => drawn.may_have_devices,
            None => devices::are_asked_for(&self.options, self.additional().chain(self.routes())),
        }
    }

    /// Returns the elements of the vehicle types, in the order in which SUMO reads them.
    pub(crate) fn types(&self) -> Vec<&Element> {
        let is_type = |element: &&Element| ["vType", "vTypeDistribution"].contains(&&*element.name);
        match &self.drawn {
            Some(drawn) => drawn.types.iter().collect(),
            None => self.additional().chain(self.routes()).flat_map(|root| &root.children).filter(is_type).collect(),
        }
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
        self.drawn_checksums().iter().for_each(|checksums| add(checksums));
        add(&format!("{:?} {:?}", self.window_s, self.options));
        // Where no program says how long a green lasts at least, the checksum is what it was before that counted.
        if self.keeps_min_dur
            && self.lights().flat_map(|light| light.all("phase")).any(|phase| phase.attribute("minDur").is_some())
        {
            add("greens last as long as programs say");
        }
        // Neither counts where it changes nothing.
        if let Some(Walking { speed_mps, walk_s }) = self.walking.filter(|_| self.has_signalled_crossing()) {
            add(&format!("people on foot walk for {walk_s} s and then at {speed_mps} m/s"));
        }
        if self.actions != Actions::default() {
            add(&format!("{:?}", self.actions));
        }
        if self.steps_per_s != 1 {
            add(&format!("{} steps per second", self.steps_per_s));
        }
        if self.demand != 1.0 {
            add(&format!("demand {}", self.demand));
        }
        if !self.closed.is_empty() {
            add(&format!("closed {:?}", self.closed));
        }
        add(self.agents().map_or("", |(_, text)| text));
        add(&self.rules);
        hasher.finalize()
    }

    /// Returns whether a light has a crossing.
    fn has_signalled_crossing(&self) -> bool {
        let edges = self.net().all("edge").filter(|edge| edge.attribute("function") == Some("crossing"));
        let crossings: HashSet<&str> = edges.filter_map(|edge| edge.attribute("id")).collect();
        let leads_to_one = |link: &Element| link.attribute("to").is_some_and(|to| crossings.contains(to));
        !crossings.is_empty()
            && self.net().all("connection").any(|link| link.attribute("tl").is_some() && leads_to_one(link))
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

fn parsed(path: &Path, text: &str) -> Result<Overrides> {
    Overrides::parse(text).map_err(|error| anyhow!("{}: {error:#}", path.display()))
}

/// Returns the keys of the config that change what an agent may do or is rewarded for, as text.
fn rules(config: &ScenarioConfig) -> Result<String> {
    let ScenarioConfig { decision_s, min_green_s, yellow_s, approach_m, reward, .. } = config;
    Ok(serde_json::to_string(&(decision_s, min_green_s, yellow_s, approach_m, reward))?)
}
