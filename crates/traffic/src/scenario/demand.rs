//! Where vehicles depart, and how many. SUMO judges the rest of the demand. But it says nothing when all depart at other times,
//! or when a type has a length of NaN, so these are errors here.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use anyhow::{Result, anyhow, ensure};

use super::departing::{Departing, VEHICLES, each};
use crate::config::sumocfg::Notes;
use crate::network::roads::attributes::{tag, wrong};
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// Largest number of vehicles of an episode.
const MOST_VEHICLES: f64 = 10_000_000.0;

/// Classes of vehicles that are often in lanes of their own, where no agent sees them.
const APART: &str = "bicycle tram rail_urban rail rail_electric rail_fast subway cable_car ship pedestrian";

/// Types that SUMO has by itself for them, with their classes.
const OWN_TYPES: [(&str, &str); 2] = [("DEFAULT_BIKETYPE", "bicycle"), ("DEFAULT_RAILTYPE", "rail")];

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
    /// Whether SUMO may remove some instead of letting them wait.
    pub(crate) some_may_vanish: bool,
}

/// What was read so far, in SUMO's order.
pub(crate) struct Demand<'a> {
    window_s: (f64, f64),
    /// Types whose vehicles are often in lanes of their own, with their classes.
    apart: HashMap<&'a str, &'a str>,
    /// Edges of each route, as their text; a distribution has several routes.
    routes: HashMap<&'a str, Vec<&'a str>>,
    zones: HashMap<&'a str, Vec<&'a str>>,
    departures: Departures,
    /// Whether there are vehicles or persons, at whatever time.
    has_some: bool,
    /// Numbers of vehicles and persons of an episode.
    expected: f64,
    persons: f64,
    /// Numbers of vehicles that are often in lanes of their own, by class.
    apart_counts: BTreeMap<&'a str, f64>,
    /// Vehicles and flows that SUMO leaves out because they come too late in their file: their number, and the first.
    late: BTreeMap<&'a Path, (usize, &'a Element)>,
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
            apart: OWN_TYPES.into(),
            routes: HashMap::new(),
            zones: HashMap::new(),
            departures: Departures::default(),
            has_some: false,
            expected: 0.0,
            persons: 0.0,
            apart_counts: BTreeMap::new(),
            late: BTreeMap::new(),
            outside: BTreeMap::new(),
            impatient: BTreeMap::new(),
        }
    }

    pub(super) fn read(&mut self, file: &'a Path, root: &'a Element, order: Order) -> Result<()> {
        let mut last_s = f64::NEG_INFINITY;
        each(root).try_for_each(|departing| {
            self.read_element(file, departing, order, &mut last_s)
                .map_err(|error| anyhow!("{}: {error}", file.display()))
        })
    }

    fn read_element(&mut self, file: &'a Path, departing: Departing<'a>, order: Order, last_s: &mut f64) -> Result<()> {
        let element = departing.element;
        match &*element.name {
            "vType" => self.add_type(element)?,
            "vTypeDistribution" => {
                element.all("vType").try_for_each(|kind| self.add_type(kind))?;
                let inner = element.all("vType").filter_map(|kind| kind.attribute("id"));
                let mut all = inner.chain(words(element, "vTypes"));
                if let Some(class) = all.find_map(|kind| self.apart.get(kind)) {
                    self.apart.insert(id(element), class);
                }
            }
            "route" | "routeDistribution" => drop(self.routes_in(element)),
            "taz" => {
                let sources = element.all("tazSource").map(id);
                self.zones.insert(id(element), words(element, "edges").chain(sources).collect());
            }
            _ if departing.departs() => {
                self.has_some = true;
                let (begin, _) = self.window_s;
                let departs_s = departing.first_s(begin);
                let is_late = order == Order::Sorted && departs_s.is_some_and(|departs_s| departs_s < *last_s);
                *last_s = departs_s.unwrap_or(*last_s).max(*last_s);
                if is_late {
                    self.late.entry(file).or_insert((0, element)).0 += 1;
                    return Ok(());
                }
                let count = departing.number(departs_s.unwrap_or(begin), self.window_s);
                if count == 0.0 {
                    *self.outside.entry(file).or_default() += 1;
                } else if VEHICLES.contains(&&*element.name) {
                    self.add_driver(file, element, count);
                } else {
                    self.persons += count;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Checks the whole. Returns where vehicles depart, and what will not be simulated. `scenario`: its path.
    pub(super) fn finish(self, scenario: &Path) -> Result<(Departures, Notes)> {
        let (begin, end) = self.window_s;
        let travellers = self.expected + self.persons;
        ensure!(
            travellers > 0.0 || !self.has_some,
            "{}: no vehicle departs from {begin} to {end} s; add a route file, or correct begin and end",
            scenario.display()
        );
        ensure!(
            travellers <= MOST_VEHICLES,
            "{}: {travellers:.0} vehicles depart from {begin} to {end} s, and at most {MOST_VEHICLES} are allowed; correct the \
             flows",
            scenario.display(),
        );
        let nobody =
            (!self.has_some).then(|| format!("{}: it names no vehicles, so the roads are empty", scenario.display()));
        let elsewhere = |(file, count): (&Path, usize)| {
            format!("{}: {count} of its vehicles and flows depart before {begin} s or from {end} s on", file.display())
        };
        let too_late = |(file, (count, first)): (&Path, (usize, &Element))| {
            format!(
                "{}: {count} of its vehicles and flows come after one that departs later, such as {}: SUMO leaves them out; sort \
                 the file by departure",
                file.display(),
                tag(first)
            )
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
        let left_out = nobody.into_iter().chain(self.outside.into_iter().map(elsewhere));
        let left_out = left_out.chain(self.late.into_iter().map(too_late));
        let left_out = left_out.chain(self.impatient.into_iter().map(may_vanish)).collect();
        let apart = |(class, count): (&str, f64)| {
            format!("vehicles of class {class} ({count:.0}): only those in lanes for cars are there")
        };
        let without_locally = self.apart_counts.into_iter().map(apart).collect();
        Ok((self.departures, Notes { left_out, without_locally, not_local: Vec::new() }))
    }

    fn add_type(&mut self, kind: &'a Element) -> Result<()> {
        let models = kind.children.iter().filter(|child| child.name.starts_with("carFollowing-"));
        for element in [kind].into_iter().chain(models) {
            for (key, value) in element.attributes.iter().filter(|(key, _)| key != "id") {
                // SUMO takes `nan` for a number, and such a car never moves, or ends SUMO.
                let may_be_infinite = key == "maxSpeed";
                let is_bad =
                    value.parse().is_ok_and(|number: f64| number.is_nan() || number.is_infinite() && !may_be_infinite);
                ensure!(!is_bad, wrong(element, key, "must be a finite number; correct it"));
            }
        }
        match kind.attribute("vClass").filter(|class| APART.split(' ').any(|other| other == *class)) {
            Some(class) => self.apart.insert(id(kind), class),
            None => self.apart.remove(id(kind)),
        };
        Ok(())
    }

    /// Returns the edges of a route or a distribution, each as a text, and remembers them and those of routes within by their
    /// ids.
    fn routes_in(&mut self, element: &'a Element) -> Vec<&'a str> {
        let mut all: Vec<&str> = element.attribute("edges").into_iter().collect();
        for known in words(element, "refId").chain(words(element, "routes")) {
            all.extend(self.routes.get(known).into_iter().flatten());
        }
        for inner in element.all("route") {
            all.extend(self.routes_in(inner));
        }
        if let Some(id) = element.attribute("id") {
            self.routes.insert(id, all.clone());
        }
        all
    }

    /// Adds a trip, a vehicle or a flow of this many vehicles.
    fn add_driver(&mut self, file: &'a Path, driver: &'a Element, vehicles: f64) {
        let given = |key: &str| driver.attribute(key);
        self.expected += vehicles;
        if let Some(class) = given("type").and_then(|kind| self.apart.get(kind)) {
            *self.apart_counts.entry(class).or_default() += vehicles;
        }
        if given("departSpeed").is_some_and(|speed| !PATIENT.contains(&speed) && speed.parse() != Ok(0.0)) {
            self.impatient.entry(file).or_insert((0, driver)).0 += 1;
            self.departures.some_may_vanish = true;
        }
        let inner = driver.children.iter().find(|child| child.name.starts_with("route"));
        let routes = match (given("route"), inner) {
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
        // Vehicles depart on the first edge, unless they name another one.
        let edges = if given("departEdge").is_some() { usize::MAX } else { 1 };
        let edges = routes.into_iter().flat_map(|route| route.split_whitespace().take(edges));
        self.departures.edges.extend(edges.map(str::to_owned));
    }
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
    fn read_whole(elements: &str) -> Result<(Departures, Notes), String> {
        let root = parse(&format!("<routes>{TYPES}{elements}</routes>")).unwrap();
        let mut demand = Demand::new((100, 200));
        let read = demand.read(Path::new("rou"), &root, Order::Sorted);
        read.and_then(|()| demand.finish(Path::new("cfg"))).map_err(|error| error.to_string())
    }

    fn read(elements: &str) -> Result<Vec<String>, String> {
        read_whole(elements).map(|(_, notes)| notes.left_out)
    }

    #[test]
    fn cars_depart_where_their_ways_begin_if_they_depart_in_the_episode() {
        let departures = |elements: &str| {
            let (Departures { edges, junctions, .. }, _) = read_whole(elements).unwrap();
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
            ("<vehicle id='w' depart='150' departEdge='1'><route edges='b c'/></vehicle>", "a b c"),
            ("<interval begin='150' end='160'><flow id='w' number='9' from='c' to='b'/></interval>", "a c"),
            ("<interval begin='50' end='100'><flow id='w' number='9' from='c' to='b'/></interval>", "a"),
            ("<trip id='w' depart='150' fromJunction='j' toJunction='j'/>", "a j"),
        ] {
            assert_eq!(departures(&format!("{other}{element}")), places, "{element}");
        }
    }

    #[test]
    fn vehicles_in_lanes_of_their_own_are_counted() {
        let (_, notes) =
            read_whole("<flow id='v' number='7' type='odd' from='a' to='b'/><person id='p' depart='300'/>").unwrap();
        assert_eq!(notes.without_locally, ["vehicles of class rail (7): only those in lanes for cars are there"]);
        assert_eq!(notes.left_out, ["rou: 1 of its vehicles and flows depart before 100 s or from 200 s on"]);
    }

    #[test]
    fn vehicles_that_come_too_late_in_a_file_are_left_out() {
        let trip = |id: &str, depart: u32| format!("<trip id='{id}' depart='{depart}' from='{id}' to='b'/>");
        let (departures, notes) = read_whole(&[trip("v", 120), trip("w", 110), trip("x", 120)].concat()).unwrap();
        assert_eq!(departures.edges.into_iter().collect::<Vec<_>>(), ["v", "x"]);
        assert!(
            notes.left_out[0].starts_with("rou: 1 of its vehicles and flows come after one"),
            "{:?}",
            notes.left_out
        );
    }

    #[test]
    fn empty_roads_are_said_and_a_time_without_anybody_is_an_error() {
        assert_eq!(read("").unwrap(), ["cfg: it names no vehicles, so the roads are empty"]);
        let error = read("<trip id='v' depart='200' from='a' to='b'/>").unwrap_err();
        assert!(error.starts_with("cfg: no vehicle departs from 100 to 200 s"), "{error}");
        assert_eq!(read("<personFlow id='p' begin='100' number='3'/>"), Ok(vec![]));
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
