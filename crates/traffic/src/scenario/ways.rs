//! Fastest ways on free roads, for vehicles of given classes and around closed edges.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap, HashMap};
use std::rc::Rc;

use crate::network::roads::{EdgeNo, Roads};

/// Names of SUMO's vehicle classes. A way for several is one that all of them may take.
pub(crate) type VehicleClasses = BTreeSet<String>;

/// Edges that follow each edge.
type Onward = Rc<Vec<Vec<EdgeNo>>>;
/// Edges from one to another, both included.
type Way = Rc<Vec<EdgeNo>>;

pub(crate) struct Ways<'a> {
    roads: &'a Roads,
    closed: BTreeSet<EdgeNo>,
    onward: HashMap<VehicleClasses, Onward>,
    /// Which edges can be reached from an edge, by number of the edge.
    reached: HashMap<(EdgeNo, VehicleClasses), Vec<bool>>,
    found: HashMap<(EdgeNo, EdgeNo, VehicleClasses), Option<Way>>,
}

impl<'a> Ways<'a> {
    pub(crate) fn new(roads: &'a Roads, closed: BTreeSet<EdgeNo>) -> Ways<'a> {
        Ways { roads, closed, onward: HashMap::new(), reached: HashMap::new(), found: HashMap::new() }
    }

    pub(crate) fn is_closed(&self, edge: EdgeNo) -> bool {
        self.closed.contains(&edge)
    }

    /// Returns whether there is a way from one edge to another.
    pub(crate) fn reaches(&mut self, from: EdgeNo, to: EdgeNo, classes: &VehicleClasses) -> bool {
        if self.is_closed(from) || self.is_closed(to) {
            return false;
        }
        let onward = self.onward(classes);
        let reached = self.reached.entry((from, classes.clone())).or_insert_with(|| {
            let mut reached = vec![false; onward.len()];
            reached[from.0] = true;
            let mut open = vec![from];
            while let Some(edge) = open.pop() {
                for &next in &onward[edge.0] {
                    if !std::mem::replace(&mut reached[next.0], true) {
                        open.push(next);
                    }
                }
            }
            reached
        });
        reached[to.0]
    }

    /// Returns the fastest way from one edge to another, with both of them. `None`: there is none.
    pub(crate) fn fastest(&mut self, from: EdgeNo, to: EdgeNo, classes: &VehicleClasses) -> Option<Way> {
        let key = (from, to, classes.clone());
        if let Some(known) = self.found.get(&key) {
            return known.clone();
        }
        let is_open = !self.is_closed(from) && !self.is_closed(to);
        let found = if is_open { self.dijkstra(from, to, classes).map(Rc::new) } else { None };
        self.found.insert(key, found.clone());
        found
    }

    /// Dijkstra's algorithm. Keys are milliseconds, because those of a heap must be in order.
    fn dijkstra(&mut self, from: EdgeNo, to: EdgeNo, classes: &VehicleClasses) -> Option<Vec<EdgeNo>> {
        let onward = self.onward(classes);
        let mut before: Vec<Option<EdgeNo>> = vec![None; onward.len()];
        let mut queue = BinaryHeap::from([Reverse((0, from, from))]);
        while let Some(Reverse((millis, edge, previous))) = queue.pop() {
            if before[edge.0].is_some() {
                continue;
            }
            before[edge.0] = Some(previous);
            if edge == to {
                break;
            }
            let after = millis + self.millis_on(edge, classes);
            queue.extend(onward[edge.0].iter().map(|&next| Reverse((after, next, edge))));
        }
        let mut way = vec![to];
        while way[way.len() - 1] != from {
            way.push(before[way[way.len() - 1].0]?);
        }
        way.reverse();
        Some(way)
    }

    fn millis_on(&self, edge: EdgeNo, classes: &VehicleClasses) -> u64 {
        let lanes = self.roads.edge(edge).lanes.iter().map(|&lane| self.roads.lane(lane));
        let usable = lanes.filter(|lane| classes.iter().any(|class| lane.classes.has(class)));
        let seconds = usable.map(|lane| lane.length_m / lane.speed_limit_mps);
        (seconds.fold(f64::INFINITY, f64::min).min(1e9) * 1000.0).ceil() as u64
    }

    /// Returns which edges all of these vehicles may take after each edge, without closed ones.
    fn onward(&mut self, classes: &VehicleClasses) -> Onward {
        if let Some(known) = self.onward.get(classes) {
            return known.clone();
        }
        let roads = self.roads;
        let for_class = |edge: EdgeNo, class: &str| -> BTreeSet<EdgeNo> {
            let may = |lane| roads.lane(lane).classes.has(class);
            let links = roads.edge(edge).lanes.iter().filter(|&&lane| may(lane));
            let links = links.flat_map(|&lane| roads.links_from(lane)).filter(|link| may(link.to));
            links.map(|link| roads.lane(link.to).edge).collect()
        };
        let of_edge = |edge: EdgeNo| -> Vec<EdgeNo> {
            if self.closed.contains(&edge) {
                return Vec::new();
            }
            let sets = classes.iter().map(|class| for_class(edge, class));
            let shared = sets.reduce(|one, other| &one & &other).unwrap_or_default();
            shared.into_iter().filter(|next| !self.closed.contains(next)).collect()
        };
        let onward: Onward = Rc::new((0..roads.edges.len()).map(|edge| of_edge(EdgeNo(edge))).collect());
        self.onward.insert(classes.clone(), onward.clone());
        onward
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::roads::example::roads;

    fn way(closed: &[&str], from: &str, to: &str, class: &str) -> Option<Vec<String>> {
        way_with(&[], closed, from, to, class)
    }

    /// `changes`: texts of the example's net, and what stands there instead.
    fn way_with(changes: &[(&str, &str)], closed: &[&str], from: &str, to: &str, class: &str) -> Option<Vec<String>> {
        let roads = roads(changes);
        let number = |name: &str| roads.edge_named(name).unwrap();
        let mut ways = Ways::new(&roads, closed.iter().map(|name| number(name)).collect());
        let classes = VehicleClasses::from([class.to_owned()]);
        let found = ways.fastest(number(from), number(to), &classes);
        assert_eq!(found.is_some(), ways.reaches(number(from), number(to), &classes));
        Some(found?.iter().map(|&edge| roads.edge(edge).id.clone()).collect())
    }

    #[test]
    fn a_way_goes_around_closed_edges_and_ends_at_lanes_for_its_vehicles_only() {
        assert_eq!(way(&[], "far", "out", "passenger").unwrap(), ["far", "near", "out"]);
        assert_eq!(way(&[], "north", "west", "passenger").unwrap(), ["north", "back", "west"]);
        assert_eq!(way(&["near"], "far", "out", "passenger"), None);
        assert_eq!(way(&["out"], "far", "out", "passenger"), None);
        let for_buses = [("<lane id='out_0'", "<lane id='out_0' allow='bus'")];
        assert!(way_with(&for_buses, &[], "far", "out", "bus").is_some());
        assert_eq!(way_with(&for_buses, &[], "far", "out", "passenger"), None);
    }
}
