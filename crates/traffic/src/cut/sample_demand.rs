//! A small demand for a local net, to look at it in sumo-gui: some cars from every entry to every exit that they reach.

use std::collections::{HashMap, VecDeque};
use std::io;

use anyhow::Result;

use super::local_net::{Exit, LocalNet};
use crate::network::roads::carries::allows;
use crate::network::roads::{EdgeNo, LaneNo, Roads};
use crate::network::tree::Element;
use crate::network::xml::{Xml, document, element, leaf};

/// Cars per hour on each entry, shared among the exits.
const CARS_PER_HOUR: f64 = 360.0;
/// Second at which the last cars come.
pub(crate) const END_S: &str = "3600";

/// Returns the text of an additional file with these types.
pub(super) fn types(types: &[&Element]) -> String {
    document("additional", |xml| types.iter().try_for_each(|kind| element(xml, kind)))
}

/// Returns the text of a route file. `types`: elements `vType` and `vTypeDistribution`; without any, SUMO's own type
/// drives.
pub(super) fn demand(net: &LocalNet, types: &[&Element]) -> Result<String> {
    let root = net.root();
    let map = Map { roads: Roads::read(&root)?, lanes: root.all("edge").flat_map(|edge| edge.all("lane")).collect() };
    let drivers = drivers(types);
    let mut flows = Vec::new();
    for entry in entries(net, &map.roads) {
        let fitting = drivers.iter().find_map(|driver| {
            let routes = map.routes(entry, &net.exits, driver.class);
            (!routes.is_empty()).then_some((driver, routes))
        });
        let Some((driver, routes)) = fitting else { continue };
        let per_hour = (CARS_PER_HOUR / routes.len() as f64).to_string();
        flows.extend(routes.into_iter().map(|route| Flow { driver: driver.id, per_hour: per_hour.clone(), route }));
    }
    Ok(document("routes", |xml| flows.iter().enumerate().try_for_each(|(number, flow)| flow.write(xml, number))))
}

/// A type of cars.
struct Driver<'a> {
    /// `None`: SUMO's own type.
    id: Option<&'a str>,
    class: &'a str,
}

/// Returns who may drive: passenger cars first, SUMO's own type at their end, then the others.
fn drivers<'a>(types: &[&'a Element]) -> Vec<Driver<'a>> {
    const CAR: &str = "passenger";
    let class = |kind: &'a Element| kind.attribute("vClass").unwrap_or(CAR);
    let named = types.iter().filter(|kind| kind.name == "vType");
    let named = named.map(|kind| Driver { id: kind.attribute("id"), class: class(kind) });
    let mut drivers: Vec<Driver> = named.chain([Driver { id: None, class: CAR }]).collect();
    drivers.sort_by_key(|driver| driver.class != CAR);
    drivers
}

/// Returns the edges with entry lanes, each once.
fn entries(net: &LocalNet, roads: &Roads) -> Vec<EdgeNo> {
    let lanes = net.entry_lanes.iter().filter_map(|lane| roads.lane_named(lane));
    let mut edges: Vec<EdgeNo> = lanes.map(|lane| roads.lane(lane).edge).collect();
    edges.dedup();
    edges
}

struct Map<'a> {
    roads: Roads,
    /// Elements of the lanes.
    lanes: Vec<&'a Element>,
}

/// Edges of a route, and where cars arrive on the last one.
struct Route {
    edges: Vec<String>,
    end_m: f64,
}

impl Map<'_> {
    /// Returns the shortest route from an edge to each exit that cars of a class can take. It goes on over the first way
    /// behind the exit that they can take.
    fn routes(&self, entry: EdgeNo, exits: &[Exit], class: &str) -> Vec<Route> {
        let before = self.search(entry, class);
        let name = |edge: EdgeNo| self.roads.edge(edge).id.clone();
        let route = |exit: &Exit| {
            let last = self.roads.edge_named(&exit.edge)?;
            let way = exit.ways.iter().find(|way| {
                let last = way.copies.last().map_or(Some(last), |copy| self.roads.edge_named(copy));
                last.is_some_and(|last| before.contains_key(&last))
            })?;
            let mut edges = vec![name(last)];
            let mut at = last;
            while at != entry {
                at = before[&at];
                edges.push(name(at));
            }
            edges.reverse();
            edges.extend(way.copies.iter().cloned());
            Some(Route { edges, end_m: way.end_m })
        };
        exits.iter().filter_map(route).collect()
    }

    /// Returns the edge before each edge that cars of a class can reach. The first edge is before itself.
    fn search(&self, from: EdgeNo, class: &str) -> HashMap<EdgeNo, EdgeNo> {
        let roads = &self.roads;
        let open = |lane: LaneNo| allows(self.lanes[lane.0], class);
        let mut before = HashMap::from([(from, from)]);
        let mut waiting = VecDeque::from([from]);
        while let Some(edge) = waiting.pop_front() {
            let links = roads.edge(edge).lanes.iter().flat_map(|&lane| roads.from_lane(lane));
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
}

struct Flow<'a> {
    driver: Option<&'a str>,
    per_hour: String,
    route: Route,
}

impl Flow<'_> {
    fn write(&self, xml: &mut Xml, number: usize) -> io::Result<()> {
        let Route { edges, end_m } = &self.route;
        let (route, flow) = (format!("way_{number}"), format!("flow_{number}"));
        leaf(xml, "route", [("id", &route), ("edges", &edges.join(" "))])?;
        let driver = self.driver.map(|driver| ("type", driver));
        let end = end_m.to_string();
        let always = [("begin", "0"), ("end", END_S), ("vehsPerHour", &self.per_hour)];
        let how = [("departLane", "best"), ("departSpeed", "max"), ("arrivalPos", &*end)];
        let names = [("id", &*flow), ("route", &*route)];
        leaf(xml, "flow", names.into_iter().chain(driver).chain(always).chain(how))
    }
}
