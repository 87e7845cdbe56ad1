//! Checks of types, routes, vehicles and flows: what SUMO would find in the middle of an episode only, or skip.
//!
//! - `types`: vehicle types and their classes; `routes`: lists of edges; `vehicles`: trips, vehicles and flows.

mod routes;
mod types;
mod vehicles;

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::place::Place;
use super::streets::{Reached, Street, Streets};
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// Largest number of vehicles of an episode.
const MOST_VEHICLES: f64 = 10_000_000.0;

/// Whether the vehicles of a file must be sorted by departure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// SUMO reads an additional file whole.
    Free,
    /// SUMO reads a route file piece by piece, and leaves out a vehicle that comes too late in it.
    Sorted,
}

/// Where the vehicles of an episode may depart.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Departures {
    /// Ids of edges.
    pub edges: BTreeSet<String>,
    /// Ids of junctions: on any edge that begins there.
    pub junctions: BTreeSet<String>,
}

/// What was read so far, in SUMO's order.
pub struct Demand<'a> {
    streets: &'a Streets<'a>,
    /// Whether SUMO was told to go on with routes that are not connected.
    lenient: bool,
    has_zones_of_junctions: bool,
    window_s: (f64, f64),
    /// Class of each type. A distribution of several has none.
    types: HashMap<&'a str, Option<&'a str>>,
    /// Routes by id; a distribution has several.
    routes: HashMap<&'a str, Vec<Vec<Street>>>,
    /// Ids of vehicles, trips and flows.
    drivers: HashSet<&'a str>,
    /// Edges from which cars of a zone depart, by the zone.
    zones: HashMap<&'a str, Vec<Street>>,
    /// Where the vehicles of an episode depart.
    departures: Departures,
    reached: HashMap<(Street, Option<&'a str>), Reached>,
    /// Expected number of vehicles from begin to end.
    expected: f64,
    /// Numbers of vehicles that depart at other times, by file.
    outside: BTreeMap<PathBuf, usize>,
    /// Vehicles and flows that SUMO may remove instead of letting them wait.
    impatient: Odd<'a>,
    /// Vehicles and flows without a way that SUMO simulates all the same.
    lost: Odd<'a>,
}

/// Vehicles and flows of which the user must know: their number in each file, and the first one.
#[derive(Default)]
struct Odd<'a>(BTreeMap<&'a Path, (usize, Place<'a>)>);

impl<'a> Odd<'a> {
    fn add(&mut self, place: Place<'a>) {
        self.0.entry(place.file).or_insert((0, place)).0 += 1;
    }
}

impl<'a> Demand<'a> {
    /// `options`: those that SUMO gets. `window_s`: begin and end of an episode.
    pub fn new(streets: &'a Streets<'a>, options: &[(String, String)], window_s: (u64, u64)) -> Demand<'a> {
        let is_on = |name: &str| {
            options.iter().any(|(key, value)| key == name && ["true", "1", "yes", "on", "t", "x"].contains(&&**value))
        };
        Demand {
            streets,
            lenient: is_on("ignore-route-errors"),
            has_zones_of_junctions: is_on("junction-taz"),
            window_s: (window_s.0 as f64, window_s.1 as f64),
            types: types::predefined(),
            routes: HashMap::new(),
            drivers: HashSet::new(),
            zones: HashMap::new(),
            departures: Departures::default(),
            reached: HashMap::new(),
            expected: 0.0,
            outside: BTreeMap::new(),
            impatient: Odd::default(),
            lost: Odd::default(),
        }
    }

    /// Reads and checks a file.
    pub fn read(&mut self, file: &'a Path, root: &'a Element, order: Order) -> Result<()> {
        let mut last_s = f64::NEG_INFINITY;
        for element in &root.children {
            let place = Place { file, element };
            match &*element.name {
                "vType" => self.add_type(place)?,
                "vTypeDistribution" => self.add_types(place)?,
                "route" | "routeDistribution" => self.add_routes(place)?,
                "taz" => self.add_zone(place)?,
                "vehicle" | "trip" | "flow" => {
                    let departs_s = self.add_driver(place)?;
                    let key = if element.name == "flow" { "begin" } else { "depart" };
                    ensure!(
                        order == Order::Free || departs_s >= last_s,
                        place.fault_in(key, format!(
                            "comes after one that departs at {last_s} s, and SUMO would leave it out; sort the file by \
                             departure"
                        ))
                    );
                    last_s = departs_s;
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Checks the whole. Returns where vehicles depart, and what will not be simulated. `scenario`: the file to name in an
    /// error.
    pub fn finish(self, scenario: &Path) -> Result<(Departures, Vec<String>)> {
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
        let elsewhere = |(file, count): (PathBuf, usize)| {
            format!("{}: {count} of its vehicles and flows depart before {begin} s or from {end} s on", file.display())
        };
        let may_vanish = |(count, first): (usize, Place<'_>)| {
            let speed = excerpt(first.element.attribute("departSpeed").unwrap_or_default());
            format!(
                "a car that cannot enter as fast as it should, such as {first} with departSpeed=\"{speed}\" ({count} in \
                 this file): SUMO removes it, and the lights decide how many these are; with departSpeed=\"max\" it waits"
            )
        };
        let stands = |(count, first): (usize, Place<'_>)| {
            format!(
                "a car that has no way, such as {first} ({count} in this file): SUMO goes on with it (ignore-route-errors), \
                 and it stands at the end of a road and blocks the lane until it is moved (time-to-teleport)"
            )
        };
        let outside = self.outside.into_iter().map(elsewhere);
        let impatient = self.impatient.0.into_values().map(may_vanish);
        let lost = self.lost.0.into_values().map(stands);
        Ok((self.departures, outside.chain(impatient).chain(lost).collect()))
    }

    fn add_zone(&mut self, place: Place<'a>) -> Result<()> {
        let id = place.needed("id")?;
        let mut sources = match place.element.attribute("edges") {
            Some(_) => self.streets_in(place, "edges")?,
            None => Vec::new(),
        };
        for end in &place.element.children {
            if end.name != "param" {
                let end = place.within(end);
                let edge = self.streets.find(end.needed("id")?);
                let edge = edge.ok_or_else(|| end.fault_in("id", "the net has no such edge"))?;
                if end.element.name == "tazSource" {
                    sources.push(edge);
                }
            }
        }
        ensure!(self.zones.insert(id, sources).is_none(), place.fault("stands twice; remove one of them"));
        Ok(())
    }

    /// Returns the edges that an attribute lists. An unknown one is an error.
    fn streets_in(&self, place: Place<'a>, key: &str) -> Result<Vec<Street>> {
        let list = place.needed(key)?;
        let find = |id: &str| {
            let unknown = || place.fault(format!("{key}: the net has no edge {}", excerpt(id)));
            self.streets.find(id).ok_or_else(unknown)
        };
        list.split_ascii_whitespace().map(find).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    /// A road from a to b and c. Only buses may go on to c, by the second lane.
    const NET: &str = r#"<net>
        <edge id="a"><lane id="a_0"/><lane id="a_1" allow="bus tram"/></edge>
        <edge id="b"><lane id="b_0" disallow="truck"/></edge>
        <edge id="c"><lane id="c_0"/></edge>
        <edge id=":j_0" function="internal"><lane id=":j_0_0"/></edge>
        <junction id="j"/>
        <connection from="a" to="b" fromLane="0" toLane="0"/>
        <connection from="a" to="c" fromLane="1" toLane="0"/>
        <connection from="c" to="b" fromLane="0" toLane="0"/>
        <connection from=":j_0" to="b" fromLane="0" toLane="0"/>
    </net>"#;

    const TYPES: &str = "<vType id='bus' vClass='bus'/><vType id='truck' vClass='truck'/>\
                         <vType id='train' vClass='rail'/><vTypeDistribution id='any' vTypes='bus truck'/>\
                         <vTypeDistribution id='odd' vTypes='bus train'/>\
                         <taz id='z' edges='a b'/><taz id='y'><tazSource id='a'/></taz>";

    /// Reads elements after the types. Returns where cars depart and what is told in the end, or the error.
    fn read_whole(options: &[(&str, &str)], elements: &str) -> Result<(Departures, Vec<String>), String> {
        let net = parse(NET).unwrap();
        let streets = Streets::of(Path::new("net"), &net).unwrap();
        let options: Vec<(String, String)> =
            options.iter().map(|&(key, value)| (key.to_owned(), value.to_owned())).collect();
        let root = parse(&format!("<routes>{TYPES}{elements}</routes>")).unwrap();
        let mut demand = Demand::new(&streets, &options, (100, 200));
        let read = demand.read(Path::new("rou"), &root, Order::Sorted);
        read.and_then(|()| demand.finish(Path::new("cfg"))).map_err(|error| error.to_string())
    }

    /// Reads elements after the types. Returns what is told in the end, or the error.
    fn read_with(options: &[(&str, &str)], elements: &str) -> Result<Vec<String>, String> {
        read_whole(options, elements).map(|(_, told)| told)
    }

    fn read(elements: &str) -> Result<Vec<String>, String> {
        read_with(&[], elements)
    }

    #[test]
    fn a_way_is_one_that_the_class_may_drive() {
        for fine in [
            "<trip id='v' depart='100' from='a' to='b'/>",
            "<trip id='v' depart='100' type='bus' from='a' to='c'/>",
            "<trip id='v' depart='100' type='bus' from='a' via='c' to='b'/>",
            "<trip id='v' depart='100' from='a' to='a'/>",
            "<vehicle id='v' depart='100' type='bus'><route edges='a c b'/></vehicle>",
            // Some cars of a distribution could, so SUMO decides.
            "<trip id='v' depart='100' type='any' from='a' to='c'/>",
            "<vehicle id='v' depart='100'><routeDistribution><route edges='a b'/><route edges='b'/></routeDistribution>\
             </vehicle>",
            "<flow id='v' begin='50' end='150' period='exp(0.1)' from='a' to='b'/>",
        ] {
            assert_eq!(read(fine), Ok(vec![]), "{fine}");
        }
        for (element, told) in [
            (
                "<trip id='v' depart='100' from='a' to='c'/>",
                "rou: <trip id=\"v\">: there is no way from edge a to edge c for the class passenger; correct the trip",
            ),
            (
                "<trip id='v' depart='100' type='truck' from='b' to='b'/>",
                "rou: <trip id=\"v\">: edge b has no lane for the class truck; correct the route",
            ),
            (
                "<trip id='v' depart='100' type='bus' from='a' via='b' to='c'/>",
                "rou: <trip id=\"v\">: there is no way from edge b to edge c for the class bus; correct the trip",
            ),
            (
                "<vehicle id='v' depart='100'><route edges='a c b'/></vehicle>",
                "rou: <vehicle id=\"v\">: its route goes from edge a to edge c, and the net has no such connection for \
                 the class passenger; correct the route",
            ),
            (
                "<trip id='v' depart='100' from=':j_0' to='b'/>",
                "rou: <trip id=\"v\">: from=\":j_0\": the net has no such edge; correct it or remove the element",
            ),
            (
                "<trip id='v' depart='100' type='odd' from='a' to='c'/>",
                "rou: <trip id=\"v\">: type=\"odd\": its class is rail, and this program simulates roads; remove it",
            ),
        ] {
            assert_eq!(read(element), Err(told.to_owned()));
        }
    }

    #[test]
    fn a_way_that_is_never_driven_is_not_checked() {
        let early = "<trip id='u' depart='99' from='a' to='c'/><trip id='v' depart='100' from='a' to='b'/>";
        assert_eq!(
            read(early),
            Ok(vec!["rou: 1 of its vehicles and flows depart before 100 s or from 200 s on".to_owned()])
        );
        let lost = "<trip id='v' depart='100' from='a' to='c'/>";
        assert!(read(lost).is_err());
        let told = read_with(&[("ignore-route-errors", "true")], lost).unwrap();
        let begins = r#"a car that has no way, such as rou: <trip id="v"> (1 in this file): SUMO goes on with it"#;
        assert!(told.len() == 1 && told[0].starts_with(begins), "SUMO was told to go on: {told:?}");
        let routes = "<vehicle id='v' depart='100'><route edges='a c b'/></vehicle>\
                      <trip id='w' depart='101' from='a' to='c'/><trip id='x' depart='102' from='a' to='b'/>";
        let told = read_with(&[("ignore-route-errors", "true")], routes).unwrap();
        assert!(told.len() == 1 && told[0].contains("(2 in this file)"), "{told:?}");
    }

    #[test]
    fn zones_and_junctions_must_be_there() {
        assert_eq!(read("<trip id='v' depart='100' fromTaz='y' toTaz='z'/>"), Ok(vec![]));
        for ends in ["from='a' toTaz='z'", "fromTaz='y' to='b'"] {
            assert_eq!(read(&format!("<trip id='v' depart='100' {ends}/>")), Ok(vec![]), "{ends}");
        }
        let half = read("<trip id='v' depart='100' toTaz='z'/>").unwrap_err();
        assert!(half.contains("has no fromTaz"), "{half}");
        let unknown = read("<trip id='v' depart='100' fromTaz='z' toTaz='x'/>").unwrap_err();
        assert_eq!(unknown, "rou: <trip id=\"v\">: toTaz=\"x\": no <taz> of this id is defined before it");
        let junctions = "<trip id='v' depart='100' fromJunction='j' toJunction='j'/>";
        assert_eq!(read_with(&[("junction-taz", "true")], junctions), Ok(vec![]));
        assert!(
            read(junctions).unwrap_err().ends_with("<junction-taz value=\"true\"/> in the .sumocfg for it; add it")
        );
        let edge = read("<taz id='w'><tazSink id='x'/></taz>").unwrap_err();
        assert_eq!(edge, "rou: <tazSink id=\"x\">: id=\"x\": the net has no such edge");
    }

    #[test]
    fn cars_depart_where_their_ways_begin_if_they_depart_in_the_episode() {
        let departures = |elements: &str| {
            let (Departures { edges, junctions }, _) = read_whole(&[("junction-taz", "true")], elements).unwrap();
            (edges.into_iter().collect::<Vec<_>>().join(" "), junctions.into_iter().collect::<Vec<_>>().join(" "))
        };
        let other = "<trip id='v' depart='100' from='a' to='b'/>";
        for (element, edges, junctions) in [
            ("<trip id='w' depart='150' type='bus' from='c' via='b' to='b'/>", "a c", ""),
            ("<trip id='w' depart='200' from='c' to='b'/>", "a", ""),
            ("<vehicle id='w' depart='150'><route edges='b'/></vehicle>", "a b", ""),
            (
                "<vehicle id='w' depart='150'><routeDistribution><route edges='c b'/><route edges='b'/>                 </routeDistribution></vehicle>",
                "a b c",
                "",
            ),
            ("<flow id='w' begin='150' period='9' fromTaz='z' toTaz='z'/>", "a b", ""),
            ("<flow id='w' begin='150' period='9' fromTaz='y' toTaz='z'/>", "a", ""),
            ("<flow id='w' begin='150' period='9' fromTaz='y' to='b'/>", "a", ""),
            ("<trip id='w' depart='150' from='c' toTaz='z'/>", "a c", ""),
            ("<trip id='w' depart='150' fromJunction='j' toJunction='j'/>", "a", "j"),
        ] {
            assert_eq!(departures(&format!("{other}{element}")), (edges.to_owned(), junctions.to_owned()), "{element}");
        }
    }

    #[test]
    fn an_absurd_number_of_cars_is_refused() {
        // 1 000 000 per hour on 400 flows in 100 s: 11 million.
        let flow = |id: usize| format!("<flow id='{id}' vehsPerHour='1000000' from='a' to='b'/>");
        let flows: String = (0..400).map(flow).collect();
        assert_eq!(
            read(&flows).unwrap_err(),
            "cfg: 11111111 vehicles depart from 100 to 200 s, and at most 10000000 are allowed; correct the flows"
        );
        // The number of a random period is the rate, in vehicles per second.
        let random = |flows: usize, rate: f64| -> String {
            (0..flows).map(|id| format!("<flow id='{id}' period='exp({rate})' from='a' to='b'/>")).collect()
        };
        assert_eq!(read(&random(900, 100.0)), Ok(vec![]));
        assert_eq!(
            read(&random(1_200, 100.0)).unwrap_err(),
            "cfg: 12000000 vehicles depart from 100 to 200 s, and at most 10000000 are allowed; correct the flows"
        );
        for odd in ["exp(0)", "exp(-1)", "exp(x)", "exp(0.1", "exp(nan)"] {
            assert_eq!(
                read(&format!("<flow id='f' period='{odd}' from='a' to='b'/>")).unwrap_err(),
                format!(
                    "rou: <flow id=\"f\">: period=\"{odd}\": must be exp(RATE), with a rate from 0.000000001 to 100 \
                     vehicles per second"
                )
            );
        }
        let nobody = read("<flow id='f' begin='0' end='100' number='200' from='a' to='b'/>").unwrap_err();
        assert_eq!(nobody, "cfg: no vehicle departs from 100 to 200 s; add a route file, or correct begin and end");
    }
}
