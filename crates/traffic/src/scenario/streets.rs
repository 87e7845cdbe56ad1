//! The edges of a net, and where a vehicle of a class can come from each of them.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use anyhow::{Context, Result, ensure};

use super::place::Place;
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// Index of an edge.
pub type Street = usize;

/// The edges of a net that vehicles drive on from one intersection to the next, and the ways between them.
#[derive(Debug)]
pub struct Streets<'a> {
    ids: HashMap<&'a str, Street>,
    edges: Vec<Edge<'a>>,
    /// Who may use a lane; lanes share the same words.
    permissions: Vec<Permission<'a>>,
    junctions: HashSet<&'a str>,
}

#[derive(Debug)]
struct Edge<'a> {
    id: &'a str,
    /// One permission per lane.
    lanes: Vec<usize>,
    next: Vec<Way>,
}

#[derive(Debug)]
struct Way {
    to: Street,
    from_lane: usize,
    to_lane: usize,
}

/// The attributes `allow` and `disallow` of a lane.
type Permission<'a> = (Option<&'a str>, Option<&'a str>);

/// A set of edges, a bit each.
#[derive(Debug)]
pub struct Reached(Vec<u64>);

const BITS: usize = u64::BITS as usize;

impl Reached {
    /// Returns whether the edge was not in the set.
    fn insert(&mut self, street: Street) -> bool {
        let is_new = !self.contains(street);
        self.0[street / BITS] |= 1 << (street % BITS);
        is_new
    }

    pub fn contains(&self, street: Street) -> bool {
        self.0[street / BITS] >> (street % BITS) & 1 == 1
    }
}

/// Edges of an intersection itself.
const INSIDE: [&str; 3] = ["internal", "crossing", "walkingarea"];

impl<'a> Streets<'a> {
    /// Reads a net that was checked. An error names a connection that leads nowhere.
    pub fn of(file: &'a Path, net: &'a Element) -> Result<Streets<'a>> {
        let mut streets = Streets {
            ids: HashMap::new(),
            edges: Vec::new(),
            permissions: Vec::new(),
            junctions: net.all("junction").filter_map(|junction| junction.attribute("id")).collect(),
        };
        let mut known: HashMap<Permission<'a>, usize> = HashMap::new();
        let outside = |edge: &&Element| !edge.attribute("function").is_some_and(|kind| INSIDE.contains(&kind));
        for edge in net.all("edge").filter(outside) {
            let permission = |lane: &'a Element| {
                let permission = (lane.attribute("allow"), lane.attribute("disallow"));
                *known.entry(permission).or_insert_with(|| {
                    streets.permissions.push(permission);
                    streets.permissions.len() - 1
                })
            };
            let lanes = edge.all("lane").map(permission).collect();
            let id = Place::new(file, edge).needed("id")?;
            streets.ids.insert(id, streets.edges.len());
            streets.edges.push(Edge { id, lanes, next: Vec::new() });
        }
        for connection in net.all("connection") {
            let place = Place::new(file, connection);
            let end = |key: &str, lane_key: &str| -> Result<Option<(Street, usize)>> {
                // Ways within an intersection begin or end on edges that are not kept here.
                let Some(&street) = streets.ids.get(place.needed(key)?) else { return Ok(None) };
                let lane = place.needed(lane_key)?.parse::<usize>().ok();
                let lane = lane.filter(|&lane| lane < streets.edges[street].lanes.len());
                lane.map(|lane| Some((street, lane))).with_context(|| {
                    place
                        .fault_in(
                            lane_key,
                            format!(
                                "edge {} has no such lane",
                                excerpt(place.element.attribute(key).unwrap_or_default())
                            ),
                        )
                        .to_string()
                })
            };
            if let (Some((from, from_lane)), Some((to, to_lane))) = (end("from", "fromLane")?, end("to", "toLane")?) {
                streets.edges[from].next.push(Way { to, from_lane, to_lane });
            }
        }
        ensure!(!streets.edges.is_empty(), "{}: has no edge", file.display());
        Ok(streets)
    }

    pub fn find(&self, id: &str) -> Option<Street> {
        self.ids.get(id).copied()
    }

    /// Returns the id of an edge.
    pub fn name(&self, street: Street) -> &'a str {
        self.edges[street].id
    }

    pub fn has_junction(&self, id: &str) -> bool {
        self.junctions.contains(id)
    }

    /// Returns whether vehicles of a class may use any lane of an edge. No class: any vehicle.
    pub fn is_open(&self, street: Street, class: Option<&str>) -> bool {
        self.edges[street].lanes.iter().any(|&lane| self.allows(lane, class))
    }

    /// Returns the edges that follow an edge for a class, maybe more than once.
    fn following(&self, street: Street, class: Option<&str>) -> impl Iterator<Item = Street> {
        let Edge { lanes, next, .. } = &self.edges[street];
        let open = move |way: &&Way| {
            self.allows(lanes[way.from_lane], class) && self.allows(self.edges[way.to].lanes[way.to_lane], class)
        };
        next.iter().filter(open).map(|way| way.to)
    }

    /// Returns whether one edge follows another for a class.
    pub fn is_followed(&self, street: Street, by: Street, class: Option<&str>) -> bool {
        self.following(street, class).any(|next| next == by)
    }

    /// Returns the edges that a vehicle of a class comes to from `from`.
    pub fn reached(&self, from: Street, class: Option<&str>) -> Reached {
        let mut reached = Reached(vec![0; self.edges.len().div_ceil(BITS)]);
        let mut open = vec![from];
        reached.insert(from);
        while let Some(street) = open.pop() {
            open.extend(self.following(street, class).filter(|&next| reached.insert(next)));
        }
        reached
    }

    fn allows(&self, permission: usize, class: Option<&str>) -> bool {
        let Some(class) = class.filter(|class| *class != "ignoring") else { return true };
        let lists = |list: &str| list.split_ascii_whitespace().any(|word| word == class || word == "all");
        match self.permissions[permission] {
            (Some(allowed), _) if !allowed.is_empty() => lists(allowed),
            (_, Some(disallowed)) => !lists(disallowed),
            _ => true,
        }
    }
}
