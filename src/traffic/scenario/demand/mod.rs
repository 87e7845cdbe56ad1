//! Checks of types, routes, vehicles and flows: what SUMO would find in the middle of an episode only, or skip.
//!
//! - `types`: vehicle types and their classes; `routes`: lists of edges; `vehicles`: trips, vehicles and flows.

mod routes;
mod types;
mod vehicles;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::place::Place;
use super::streets::{Reached, Street, Streets};
use crate::traffic::network::tree::Element;

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
    zones: HashSet<&'a str>,
    reached: HashMap<(Street, Option<&'a str>), Reached>,
    /// Expected number of vehicles from begin to end.
    expected: f64,
    /// Numbers of vehicles that depart at other times, by file.
    outside: BTreeMap<PathBuf, usize>,
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
            zones: HashSet::new(),
            reached: HashMap::new(),
            expected: 0.0,
            outside: BTreeMap::new(),
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

    /// Checks the whole. Returns what will not be simulated. `scenario`: the file to name in an error.
    pub fn finish(self, scenario: &Path) -> Result<Vec<String>> {
        let (begin, end) = self.window_s;
        ensure!(
            self.expected > 0.0,
            "{}: no vehicle departs from {begin} to {end} s; add a route file, or correct begin and end",
            scenario.display()
        );
        ensure!(
            self.expected <= MOST_VEHICLES,
            "{}: {:.0} vehicles depart from {begin} to {end} s, and at most {MOST_VEHICLES} are allowed; correct the flows",
            scenario.display(),
            self.expected
        );
        let told = |(file, count): (PathBuf, usize)| {
            format!("{}: {count} vehicles and flows depart before {begin} s or from {end} s on", file.display())
        };
        Ok(self.outside.into_iter().map(told).collect())
    }

    fn add_zone(&mut self, place: Place<'a>) -> Result<()> {
        ensure!(self.zones.insert(place.needed("id")?), place.fault("stands twice; remove one of them"));
        if place.element.attribute("edges").is_some() {
            self.streets_in(place, "edges")?;
        }
        for end in &place.element.children {
            if end.name != "param" {
                let end = place.within(end);
                let edge = end.needed("id")?;
                ensure!(self.streets.find(edge).is_some(), end.fault_in("id", "the net has no such edge"));
            }
        }
        Ok(())
    }

    /// Returns the edges that an attribute lists. An unknown one is an error.
    fn streets_in(&self, place: Place<'a>, key: &str) -> Result<Vec<Street>> {
        let list = place.needed(key)?;
        let find = |id: &str| {
            let unknown = || place.fault(format!("{key}: the net has no edge {}", crate::outside::excerpt(id)));
            self.streets.find(id).ok_or_else(unknown)
        };
        list.split_ascii_whitespace().map(find).collect()
    }
}
