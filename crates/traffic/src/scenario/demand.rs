//! Where vehicles depart, and how many. SUMO judges the rest of the demand. But it says nothing when all depart at other times, and
//! it takes all memory if there are too many, so these are errors here.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use anyhow::{Result, anyhow, ensure};

use super::departing::{Departing, VEHICLES, each};
use super::own_types::{OWN_TYPES, USUAL_TYPE};
use crate::config::sumocfg::Notes;
use crate::network::roads::attributes::{tag, wrong};
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// Largest number of vehicles of an episode.
const MOST_VEHICLES: f64 = 10_000_000.0;

/// Largest number of edges of all routes that repeat themselves. SUMO writes such a route down as often as it says.
const MOST_REPEATED_EDGES: f64 = 10_000_000.0;

/// Memory of a stop on a route, in that of an edge.
const STOP_IN_EDGES: usize = 80;

/// Seconds before the end of an episode from which on a vehicle may find no room any more.
const LATE_S: f64 = 60.0;

/// Classes of vehicles that are often in lanes of their own, where no agent sees them.
const APART: &str = "bicycle tram rail_urban rail rail_electric rail_fast subway cable_car ship pedestrian";

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

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Departures {
    pub(crate) edges: BTreeSet<String>,
    /// Ids of junctions: on any edge that begins there.
    pub(crate) junctions: BTreeSet<String>,
    /// Whether SUMO may remove some instead of letting them wait.
    pub(crate) some_may_vanish: bool,
    /// Least number of vehicles that want to enter in an episode, whatever random numbers say.
    pub(crate) at_least: f64,
}

impl Departures {
    /// Returns the departures of an episode that plays either of two route files.
    pub(super) fn or(mut self, other: Departures) -> Departures {
        self.edges.extend(other.edges);
        self.junctions.extend(other.junctions);
        Departures {
            some_may_vanish: self.some_may_vanish || other.some_may_vanish,
            at_least: self.at_least.min(other.at_least),
            ..self
        }
    }
}

/// What was read so far, in SUMO's order.
pub(crate) struct Demand<'a> {
    window_s: (f64, f64),
    /// How many vehicles SUMO makes of each one: its option `scale`.
    scale: f64,
    /// The same of types, if they say it. Of a distribution: the least and the largest.
    scales: HashMap<&'a str, (f64, f64)>,
    repeated_edges: f64,
    /// Expected number of vehicles of which some may not come.
    at_random: f64,
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
    /// `window_s`: begin and end of an episode. `scale`: how many vehicles SUMO makes of each one.
    pub(super) fn new(window_s: (u64, u64), scale: f64) -> Demand<'a> {
        Demand {
            window_s: (window_s.0 as f64, window_s.1 as f64),
            scale: scale.max(0.0),
            scales: HashMap::new(),
            repeated_edges: 0.0,
            at_random: 0.0,
            apart: OWN_TYPES.into_iter().filter(|(_, class)| is_apart(class)).collect(),
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
        let in_file = |error| anyhow!("{}: {error}", file.display());
        self.count_repeated(root).map_err(in_file)?;
        each(root).for_each(|departing| self.read_element(file, departing, order, &mut last_s));
        Ok(())
    }

    /// Adds the edges of routes that repeat themselves, wherever they stand.
    fn count_repeated(&mut self, element: &Element) -> Result<()> {
        for child in &element.children {
            if let Some(repeat) = child.attribute("repeat").filter(|_| child.name == "route") {
                let edges = child.words("edges").count() + STOP_IN_EDGES * child.all("stop").count();
                self.repeated_edges += edges as f64 * repeat.trim().parse::<f64>().unwrap_or(0.0).max(0.0);
                let why = format!(
                    "with it the routes have {:.0} edges, and at most {MOST_REPEATED_EDGES} are allowed; correct it",
                    self.repeated_edges
                );
                ensure!(self.repeated_edges <= MOST_REPEATED_EDGES, wrong(child, "repeat", &why));
            }
            self.count_repeated(child)?;
        }
        Ok(())
    }

    fn read_element(&mut self, file: &'a Path, departing: Departing<'a>, order: Order, last_s: &mut f64) {
        let element = departing.element;
        match &*element.name {
            "vType" => self.add_type(element),
            "vTypeDistribution" => {
                element.all("vType").for_each(|kind| self.add_type(kind));
                let inner = element.all("vType").filter_map(|kind| kind.attribute("id"));
                let all: Vec<&str> = inner.chain(element.words("vTypes")).collect();
                if let Some(class) = all.iter().find_map(|kind| self.apart.get(kind)) {
                    self.apart.insert(element.id(), class);
                }
                let scales = all.iter().map(|kind| self.scale_of(kind));
                let scales = scales.reduce(|one, other| (one.0.min(other.0), one.1.max(other.1)));
                self.scales.insert(element.id(), scales.unwrap_or((1.0, 1.0)));
            }
            "route" | "routeDistribution" => drop(self.routes_in(element)),
            "taz" => {
                let sources = element.all("tazSource").map(Element::id);
                self.zones.insert(element.id(), element.words("edges").chain(sources).collect());
            }
            _ if departing.departs() => {
                self.has_some = true;
                let (begin, _) = self.window_s;
                let departs_s = departing.first_s(begin);
                let is_late = order == Order::Sorted && departs_s.is_some_and(|departs_s| departs_s < *last_s);
                *last_s = departs_s.unwrap_or(*last_s).max(*last_s);
                if is_late {
                    self.late.entry(file).or_insert((0, element)).0 += 1;
                    return;
                }
                let count = departing.number(departs_s.unwrap_or(begin), self.window_s);
                if count == 0.0 {
                    *self.outside.entry(file).or_default() += 1;
                } else if VEHICLES.contains(&&*element.name) {
                    self.add_driver(file, element, count);
                    // What waits for somebody departs when that one wants.
                    if let Some(departs_s) = departs_s {
                        let scale = self.scale * self.scale_of(type_of(element)).0;
                        let early = scale * departing.number(departs_s, (begin, self.window_s.1 - LATE_S));
                        // With a scale below 1 SUMO decides which ones there are.
                        let is_sure = scale >= 1.0 && !departing.is_random();
                        *if is_sure { &mut self.departures.at_least } else { &mut self.at_random } += early;
                    }
                } else {
                    self.persons += count;
                }
            }
            _ => {}
        }
    }

    /// Returns how many vehicles SUMO makes of one of a type: the least number, and the largest.
    fn scale_of(&self, kind: &str) -> (f64, f64) {
        self.scales.get(kind).copied().unwrap_or((1.0, 1.0))
    }

    /// Checks the whole. Returns where vehicles depart, and what will not be simulated. `scenario`: its path.
    pub(super) fn finish(mut self, scenario: &Path) -> Result<(Departures, Notes)> {
        let (begin, end) = self.window_s;
        let travellers = self.expected + self.persons;
        // Of 20 vehicles that are expected at random, none comes with a probability of 2e-9.
        self.departures.at_least = (self.departures.at_least + (self.at_random - 19.0).max(0.0)).floor();
        ensure!(
            self.scale > 0.0 || !self.has_some,
            "{}: option scale is 0, so SUMO makes no vehicle; correct it",
            scenario.display()
        );
        ensure!(
            travellers > 0.0 || !self.has_some,
            "{}: no vehicle departs from {begin} to {end} s; add a route file, or correct begin and end",
            scenario.display()
        );
        ensure!(
            travellers <= MOST_VEHICLES,
            "{}: {travellers:.0} vehicles depart from {begin} to {end} s, and at most {MOST_VEHICLES} are allowed; correct the \
             flows{}",
            scenario.display(),
            if self.scale == 1.0 && self.scales.values().all(|scales| *scales == (1.0, 1.0)) {
                ""
            } else {
                ", or scale"
            }
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

    fn add_type(&mut self, kind: &'a Element) {
        if let Some(scale) = kind.attribute("scale").and_then(|scale| scale.trim().parse::<f64>().ok()) {
            self.scales.insert(kind.id(), (scale.max(0.0), scale.max(0.0)));
        }
        match kind.attribute("vClass").filter(|class| is_apart(class)) {
            Some(class) => self.apart.insert(kind.id(), class),
            None => self.apart.remove(kind.id()),
        };
    }

    /// Returns the edges of a route or a distribution, each as a text, and remembers them and those of routes within by their
    /// ids.
    fn routes_in(&mut self, element: &'a Element) -> Vec<&'a str> {
        let mut all: Vec<&str> = element.attribute("edges").into_iter().collect();
        for known in element.words("refId").chain(element.words("routes")) {
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
        let vehicles = vehicles * self.scale * self.scale_of(type_of(driver)).1;
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

fn type_of(driver: &Element) -> &str {
    driver.attribute("type").unwrap_or(USUAL_TYPE)
}

fn is_apart(class: &str) -> bool {
    APART.split(' ').any(|other| other == class)
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
        let mut demand = Demand::new((100, 200), 1.0);
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
