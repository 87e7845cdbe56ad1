//! Where vehicles depart, and how many. SUMO judges the rest of the demand. But it says nothing when vehicles depart
//! too late in a file, when none departs at all, or when a type has a length of NaN, so these are errors here.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};

use crate::config::sumo_options::refused_parameter;
use crate::config::sumo_time::seconds;
use crate::network::roads::attributes::{tag, wrong};
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// Largest number of vehicles of an episode.
const MOST_VEHICLES: f64 = 10_000_000.0;

/// Classes of what does not drive on roads.
const NOT_ON_ROADS: &str = "tram rail_urban rail rail_electric rail_fast ship pedestrian container";

/// Types that SUMO has by itself for them, with their classes.
const OWN_TYPES: [(&str, &str); 3] =
    [("DEFAULT_PEDTYPE", "pedestrian"), ("DEFAULT_RAILTYPE", "rail"), ("DEFAULT_CONTAINERTYPE", "container")];

/// Times of departure that wait for something else.
const TRIGGERED: [&str; 3] = ["triggered", "containerTriggered", "split"];

/// Speeds of departure with which a car waits until there is room for it, and is slowed down to fit. Cars with all others
/// are removed if the road does not let them drive so fast. How many that are depends on the lights.
/// Measured on SUMO 1.15 with 500 trips: `desired`, `speedLimit`, `last`, `avg` and 5 m/s lose cars.
const PATIENT: [&str; 2] = ["max", "random"];

/// Whether the vehicles of a file must be sorted by departure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// SUMO reads an additional file whole.
    Free,
    /// SUMO reads a route file piece by piece, and leaves out a vehicle that comes too late in it.
    Sorted,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Departures {
    pub(crate) edges: BTreeSet<String>,
    /// Ids of junctions: on any edge that begins there.
    pub(crate) junctions: BTreeSet<String>,
}

/// What was read so far, in SUMO's order.
pub(crate) struct Demand<'a> {
    window_s: (f64, f64),
    strange: HashMap<&'a str, &'a str>,
    /// First edges of each route; a distribution has several.
    routes: HashMap<&'a str, Vec<&'a str>>,
    zones: HashMap<&'a str, Vec<&'a str>>,
    departures: Departures,
    expected: f64,
    /// Numbers of vehicles and flows that depart at other times, by file.
    outside: BTreeMap<&'a Path, usize>,
    /// Vehicles and flows that SUMO may remove instead of letting them wait: their number in each file, and the first.
    impatient: BTreeMap<&'a Path, (usize, &'a Element)>,
}

impl<'a> Demand<'a> {
    /// `window_s`: begin and end of an episode.
    pub(super) fn new(window_s: (u64, u64)) -> Demand<'a> {
        Demand {
            window_s: (window_s.0 as f64, window_s.1 as f64),
            strange: OWN_TYPES.into(),
            routes: HashMap::new(),
            zones: HashMap::new(),
            departures: Departures::default(),
            expected: 0.0,
            outside: BTreeMap::new(),
            impatient: BTreeMap::new(),
        }
    }

    pub(super) fn read(&mut self, file: &'a Path, root: &'a Element, order: Order) -> Result<()> {
        let mut last_s = f64::NEG_INFINITY;
        let mut read = |element| self.read_element(file, element, order, &mut last_s);
        root.children
            .iter()
            .try_for_each(|element| read(element).map_err(|error| anyhow!("{}: {error}", file.display())))
    }

    fn read_element(&mut self, file: &'a Path, element: &'a Element, order: Order, last_s: &mut f64) -> Result<()> {
        match &*element.name {
            "vType" => self.add_type(element)?,
            "vTypeDistribution" => {
                element.all("vType").try_for_each(|kind| self.add_type(kind))?;
                let inner = element.all("vType").filter_map(|kind| kind.attribute("id"));
                let mut all = inner.chain(words(element, "vTypes"));
                if let Some(class) = all.find_map(|kind| self.strange.get(kind)) {
                    self.strange.insert(id(element), class);
                }
            }
            "route" | "routeDistribution" => drop(self.routes_in(element)),
            "taz" => {
                let sources = element.all("tazSource").map(id);
                self.zones.insert(id(element), words(element, "edges").chain(sources).collect());
            }
            "vehicle" | "trip" | "flow" => {
                let key = if element.name == "flow" { "begin" } else { "depart" };
                let departs_s = match element.attribute(key) {
                    Some(text) => seconds(text).ok(),
                    None => Some(self.window_s.0),
                };
                self.add_driver(file, element, departs_s.unwrap_or(self.window_s.0))?;
                let why = || {
                    format!(
                        "comes after one that departs at {last_s} s, and SUMO would leave it out; sort the file by departure"
                    )
                };
                let is_late = departs_s.is_some_and(|departs_s| departs_s < *last_s);
                ensure!(order == Order::Free || !is_late, wrong(element, key, &why()));
                *last_s = departs_s.unwrap_or(*last_s);
            }
            _ => {}
        }
        Ok(())
    }

    /// Checks the whole. Returns where vehicles depart, and what will not be simulated. `scenario`: its path.
    pub(super) fn finish(self, scenario: &Path) -> Result<(Departures, Vec<String>)> {
        let (begin, end) = self.window_s;
        ensure!(
            self.expected > 0.0,
            "{}: no vehicle departs from {begin} to {end} s; add a route file, or correct begin and end",
            scenario.display()
        );
        ensure!(
            self.expected <= MOST_VEHICLES,
            "{}: {:.0} vehicles depart from {begin} to {end} s, and at most {MOST_VEHICLES} are allowed; correct the \
             flows",
            scenario.display(),
            self.expected
        );
        let elsewhere = |(file, count): (&Path, usize)| {
            format!("{}: {count} of its vehicles and flows depart before {begin} s or from {end} s on", file.display())
        };
        let may_vanish = |(file, (count, first)): (&Path, (usize, &Element))| {
            let speed = excerpt(first.attribute("departSpeed").unwrap_or_default());
            format!(
                "a car that cannot enter as fast as it should, such as {}: {} with departSpeed=\"{speed}\" ({count} in \
                 this file): SUMO removes it, and the lights decide how many these are; with departSpeed=\"max\" it waits",
                file.display(),
                tag(first)
            )
        };
        let outside = self.outside.into_iter().map(elsewhere);
        Ok((self.departures, outside.chain(self.impatient.into_iter().map(may_vanish)).collect()))
    }

    fn add_type(&mut self, kind: &'a Element) -> Result<()> {
        let models = kind.children.iter().filter(|child| child.name.starts_with("carFollowing-"));
        for element in [kind].into_iter().chain(models) {
            for (key, value) in element.attributes.iter().filter(|(key, _)| key != "id") {
                // SUMO takes `nan` for a number, and such a car never moves, or ends SUMO.
                let is_bad = value.parse().is_ok_and(|number: f64| !number.is_finite());
                ensure!(!is_bad, wrong(element, key, "must be a finite number; correct it"));
            }
        }
        refuse_devices(kind)?;
        match kind.attribute("vClass").filter(|class| NOT_ON_ROADS.split(' ').any(|other| other == *class)) {
            Some(class) => self.strange.insert(id(kind), class),
            None => self.strange.remove(id(kind)),
        };
        Ok(())
    }

    /// Returns the first edges of a route or a distribution, and remembers them and those of routes within by their ids.
    fn routes_in(&mut self, element: &'a Element) -> Vec<&'a str> {
        let mut first: Vec<&str> = words(element, "edges").take(1).collect();
        for known in words(element, "refId").chain(words(element, "routes")) {
            first.extend(self.routes.get(known).into_iter().flatten());
        }
        for inner in element.all("route") {
            first.extend(self.routes_in(inner));
        }
        if let Some(id) = element.attribute("id") {
            self.routes.insert(id, first.clone());
        }
        first
    }

    /// Adds a trip, a vehicle or a flow. `departs_s`: the second of its first departure.
    fn add_driver(&mut self, file: &'a Path, driver: &'a Element, departs_s: f64) -> Result<()> {
        let given = |key: &str| driver.attribute(key);
        for (key, why) in [
            ("personNumber", "this program does not simulate persons and containers; remove it"),
            ("containerNumber", "this program does not simulate persons and containers; remove it"),
            ("departEdge", "this program lets cars begin on the first edge of their route; remove it"),
        ] {
            ensure!(given(key).is_none_or(|value| value == "0"), wrong(driver, key, why));
        }
        ensure!(
            given("depart").is_none_or(|depart| !TRIGGERED.contains(&depart)),
            wrong(driver, "depart", "this program does not simulate persons and trains; set a second")
        );
        if let Some(class) = given("type").and_then(|kind| self.strange.get(kind)) {
            let why = format!("its class is {class}, and this program simulates roads; remove it");
            bail!(wrong(driver, "type", &why));
        }
        refuse_devices(driver)?;
        let (begin, end) = self.window_s;
        let vehicles = match driver.name == "flow" {
            true => vehicles_of(driver, departs_s, self.window_s),
            false => f64::from((begin..end).contains(&departs_s)),
        };
        if vehicles == 0.0 {
            *self.outside.entry(file).or_default() += 1;
            return Ok(());
        }
        self.expected += vehicles;
        if given("departSpeed").is_some_and(|speed| !PATIENT.contains(&speed) && speed.parse() != Ok(0.0)) {
            self.impatient.entry(file).or_insert((0, driver)).0 += 1;
        }
        let inner = driver.children.iter().find(|child| child.name != "param");
        let edges = match (given("route"), inner) {
            (Some(route), _) => self.routes.get(route).cloned().unwrap_or_default(),
            (None, Some(inner)) => self.routes_in(inner),
            (None, None) => match (given("from"), given("fromTaz")) {
                (Some(edge), _) => vec![edge],
                (None, Some(zone)) => self.zones.get(zone).cloned().unwrap_or_default(),
                (None, None) => {
                    self.departures.junctions.extend(given("fromJunction").map(str::to_owned));
                    Vec::new()
                }
            },
        };
        self.departures.edges.extend(edges.into_iter().map(str::to_owned));
        Ok(())
    }
}

/// Returns the expected number of vehicles of a flow in an episode; 1 if it cannot be read, which SUMO will say.
fn vehicles_of(flow: &Element, begins: f64, (begin, end): (f64, f64)) -> f64 {
    let ends = flow.attribute("end").and_then(|text| seconds(text).ok()).unwrap_or(end);
    let shared = (ends.min(end) - begins.max(begin)).max(0.0);
    let number = |key: &str| flow.attribute(key)?.trim().parse::<f64>().ok();
    match (number("number"), vehicles_per_s(flow).or_else(|| number("probability"))) {
        (None, None) => 1.0,
        (Some(number), None) if ends > begins => number * shared / (ends - begins),
        (Some(number), None) => number * f64::from((begin..end).contains(&begins)),
        (number, Some(rate)) => (rate * shared).min(number.unwrap_or(f64::INFINITY)),
    }
}

/// Returns the rate of a flow that names one, or a period.
pub(super) fn vehicles_per_s(flow: &Element) -> Option<f64> {
    let number = |key: &str| flow.attribute(key)?.trim().parse::<f64>().ok();
    let per_hour = ["vehsPerHour", "perHour", "personsPerHour"].into_iter().find_map(number);
    // The number of a random period is its rate.
    let random = || flow.attribute("period")?.trim().strip_prefix("exp(")?.strip_suffix(')')?.trim().parse().ok();
    per_hour.map(|rate| rate / 3600.0).or_else(|| number("period").map(|period| 1.0 / period)).or_else(random)
}

/// Returns an error if a parameter of a type, vehicle or flow gives it a device that is refused as an option, too.
fn refuse_devices(element: &Element) -> Result<()> {
    for parameter in element.all("param") {
        let [key, value] = ["key", "value"].map(|name| parameter.attribute(name).unwrap_or_default());
        if let Some(why) = refused_parameter(key, value) {
            bail!("{}: <param key=\"{}\">: {why}; remove it", tag(element), excerpt(key));
        }
    }
    Ok(())
}

fn id(element: &Element) -> &str {
    element.attribute("id").unwrap_or_default()
}

fn words<'a>(element: &'a Element, key: &str) -> impl Iterator<Item = &'a str> {
    element.attribute(key).unwrap_or_default().split_ascii_whitespace()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    const TYPES: &str = "<vType id='bus' vClass='bus'/><vType id='train' vClass='rail'/>\
                         <vTypeDistribution id='odd' vTypes='bus train'/>\
                         <taz id='z' edges='a b'/><taz id='y'><tazSource id='a'/></taz>";

    /// Reads elements after the types. Returns where cars depart and the notes, or the error.
    fn read_whole(elements: &str) -> Result<(Departures, Vec<String>), String> {
        let root = parse(&format!("<routes>{TYPES}{elements}</routes>")).unwrap();
        let mut demand = Demand::new((100, 200));
        let read = demand.read(Path::new("rou"), &root, Order::Sorted);
        read.and_then(|()| demand.finish(Path::new("cfg"))).map_err(|error| error.to_string())
    }

    fn read(elements: &str) -> Result<Vec<String>, String> {
        read_whole(elements).map(|(_, notes)| notes)
    }

    #[test]
    fn cars_depart_where_their_ways_begin_if_they_depart_in_the_episode() {
        let departures = |elements: &str| {
            let (Departures { edges, junctions }, _) = read_whole(elements).unwrap();
            edges.into_iter().chain(junctions).collect::<Vec<_>>().join(" ")
        };
        let other = "<trip id='v' depart='100' from='a' to='b'/>";
        for (element, places) in [
            ("<trip id='w' depart='150' type='bus' from='c' via='b' to='b'/>", "a c"),
            ("<trip id='w' depart='200' from='c' to='b'/>", "a"),
            ("<vehicle id='w' depart='150'><route edges='b'/></vehicle>", "a b"),
            (
                "<vehicle id='w' depart='150'><routeDistribution><route edges='c b'/><route edges='b'/>\
                 </routeDistribution></vehicle>",
                "a b c",
            ),
            (
                "<routeDistribution id='r'><route id='s' edges='c b'/></routeDistribution>\
                 <vehicle id='w' depart='150'><route refId='s'/></vehicle>",
                "a c",
            ),
            ("<flow id='w' begin='150' period='9' fromTaz='z' toTaz='z'/>", "a b"),
            ("<flow id='w' begin='150' period='9' fromTaz='y' to='b'/>", "a"),
            ("<trip id='w' depart='150' from='c' toTaz='z'/>", "a c"),
            ("<trip id='w' depart='150' fromJunction='j' toJunction='j'/>", "a j"),
        ] {
            assert_eq!(departures(&format!("{other}{element}")), places, "{element}");
        }
    }

    #[test]
    fn a_distribution_with_a_train_is_refused() {
        let error = read("<trip id='v' depart='100' type='odd' from='a' to='b'/>").unwrap_err();
        assert!(error.contains("type=\"odd\": its class is rail"), "{error}");
    }

    #[test]
    fn an_absurd_number_of_cars_is_refused() {
        let flows = |count: usize, how: &str| -> String {
            (0..count).map(|id| format!("<flow id='{id}' {how} from='a' to='b'/>")).collect()
        };
        // 1 000 000 per hour on 400 flows in 100 s: 11 million.
        assert_eq!(
            read(&flows(400, "vehsPerHour='1000000'")).unwrap_err(),
            "cfg: 11111111 vehicles depart from 100 to 200 s, and at most 10000000 are allowed; correct the flows"
        );
        // The number of a random period is the rate, in vehicles per second.
        assert_eq!(read(&flows(900, "period='exp(100)'")), Ok(vec![]));
        assert!(read(&flows(1_200, "period='exp(100)'")).unwrap_err().starts_with("cfg: 12000000 vehicles depart"));
        // SUMO would never come to the end of a step.
        assert!(["NaN", "inf"].iter().all(|rate| read(&flows(1, &format!("period='exp({rate})'"))).is_err()));
    }
}
