//! A small demand for a local net, to look at it in sumo-gui: some cars from every entry to every exit that they reach.

use std::collections::{HashMap, VecDeque};
use std::iter::successors;

use anyhow::Result;

use super::local_net::{Exit, LocalNet};
use crate::network::roads::{EdgeNo, LaneNo, Roads};
use crate::network::tree::Element;
use crate::network::xml::{document, element, leaf};

/// Cars per hour on each entry, shared among the exits.
const CARS_PER_HOUR: f64 = 360.0;
/// Second at which the last cars come.
pub(crate) const END_S: &str = "3600";

pub(super) fn types(types: &[&Element]) -> String {
    document("additional", |xml| types.iter().try_for_each(|kind| element(xml, kind)))
}

/// Returns the text of a route file. Without `types`, SUMO's own type drives.
pub(super) fn demand(net: &LocalNet, types: &[&Element]) -> Result<String> {
    let roads = Roads::read(net.root())?;
    let drivers = drivers(types);
    let fitting = |entry| {
        drivers.iter().find_map(|(driver, class)| {
            let routes = routes(&roads, entry, &net.exits, class);
            (!routes.is_empty()).then_some((*driver, routes))
        })
    };
    let entry_lanes = net.entry_lanes.iter().filter_map(|lane| roads.lane_named(lane));
    let mut entries: Vec<EdgeNo> = entry_lanes.map(|lane| roads.lane(lane).edge).collect();
    entries.dedup();
    let flows: Vec<_> = entries.into_iter().filter_map(fitting).collect();
    Ok(document("routes", |xml| {
        let mut numbers = 0..;
        for (driver, routes) in &flows {
            let per_hour = (CARS_PER_HOUR / routes.len() as f64).to_string();
            routes.iter().zip(&mut numbers).try_for_each(|((edges, end_m), number)| {
                let (route, flow, end) = (format!("way_{number}"), format!("flow_{number}"), end_m.to_string());
                leaf(xml, "route", [("id", &route), ("edges", &edges.join(" "))])?;
                let names =
                    [("id", &*flow), ("route", &*route)].into_iter().chain(driver.map(|driver| ("type", driver)));
                let times = [("begin", "0"), ("end", END_S), ("vehsPerHour", &per_hour)];
                let how = [("departLane", "best"), ("departSpeed", "max"), ("arrivalPos", &*end)];
                leaf(xml, "flow", names.chain(times).chain(how))
            })?;
        }
        Ok(())
    }))
}

/// Returns the types of cars that may drive, with their classes: passenger cars first, then SUMO's own type.
fn drivers<'a>(types: &[&'a Element]) -> Vec<(Option<&'a str>, &'a str)> {
    const CAR: &str = "passenger";
    let named = types.iter().filter(|kind| kind.name == "vType");
    let named = named.map(|kind| (kind.attribute("id"), kind.attribute("vClass").unwrap_or(CAR)));
    let mut drivers: Vec<_> = named.chain([(None, CAR)]).collect();
    drivers.sort_by_key(|(_, class)| *class != CAR);
    drivers
}

/// Returns the shortest route from an edge to each exit, and a way behind it, that cars of a class can take.
fn routes(roads: &Roads, entry: EdgeNo, exits: &[Exit], class: &str) -> Vec<(Vec<String>, f64)> {
    let before = search(roads, entry, class);
    let route = |exit: &Exit| {
        let last = roads.edge_named(&exit.edge)?;
        let way = exit.ways.iter().find(|way| {
            let last = way.copies.last().map_or(Some(last), |copy| roads.edge_named(copy));
            last.is_some_and(|last| before.contains_key(&last))
        })?;
        let mut edges: Vec<EdgeNo> = successors(Some(last), |at| Some(before[at]).filter(|_| *at != entry)).collect();
        edges.reverse();
        let names = edges.into_iter().map(|edge| roads.edge(edge).id.clone());
        Some((names.chain(way.copies.iter().cloned()).collect(), way.end_m))
    };
    exits.iter().filter_map(route).collect()
}

/// Returns the edge before each edge that cars of a class can reach. The first edge is before itself.
fn search(roads: &Roads, from: EdgeNo, class: &str) -> HashMap<EdgeNo, EdgeNo> {
    let open = |lane: LaneNo| roads.lane(lane).classes.has(class);
    let mut before = HashMap::from([(from, from)]);
    let mut waiting = VecDeque::from([from]);
    while let Some(edge) = waiting.pop_front() {
        let links = roads.edge(edge).lanes.iter().flat_map(|&lane| roads.links_from(lane));
        for link in links.filter(|link| roads.is_road(link.to) && open(link.from) && open(link.to)) {
            let next = roads.lane(link.to).edge;
            before.entry(next).or_insert_with(|| {
                waiting.push_back(next);
                edge
            });
        }
    }
    before
}
