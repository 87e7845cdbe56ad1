//! What lies behind the exits of a region: copies of the next edges, because cars choose their lanes by where they go
//! next. And junctions at the border, which become dead ends.

use std::collections::HashSet;

use super::extract::Source;
use super::local_net::{Exit, Gate, Way};
use crate::network::roads::{EdgeNo, LaneNo};
use crate::network::tree::Element;

/// Distance that a car still drives on the last edge of its way, in metres.
const LAST_M: f64 = 15.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Largest number of edges one behind the other.
    pub hops: usize,
    /// No edge begins farther behind the exit, in metres.
    pub metres: f64,
}

impl Reach {
    pub(crate) const USUAL_HOPS: usize = 3;
}

impl Default for Reach {
    /// Returns the reach with which fidelity was measured. Where edges are short, drivers choose their lanes by a turn that is
    /// several edges away.
    fn default() -> Reach {
        Reach { hops: Reach::USUAL_HOPS, metres: 150.0 }
    }
}

pub(super) struct Beyond<'a> {
    source: &'a Source<'a>,
    reach: Reach,
    /// Names that the net does not have, and the copies have.
    taken: HashSet<String>,
    gate: Gate,
    pub(super) exits: Vec<Exit>,
    pub(super) elements: Vec<Element>,
}

impl<'a> Beyond<'a> {
    pub(super) fn new(source: &'a Source<'a>, light: &str, reach: Reach) -> Beyond<'a> {
        let mut beyond = Beyond {
            source,
            reach,
            taken: HashSet::new(),
            gate: Gate { light: String::new(), lanes: Vec::new() },
            exits: Vec::new(),
            elements: Vec::new(),
        };
        beyond.gate.light = beyond.free_name(format!("{light}+exits"));
        beyond
    }

    pub(super) fn add(&mut self, exit: EdgeNo) {
        let edge = self.source.roads.edge(exit);
        let way = Way { edges: Vec::new(), copies: Vec::new(), end_m: self.length_m(exit) };
        let mut ways = Vec::new();
        self.follow(exit, &edge.id, 0.0, way, &mut ways);
        let for_cars = edge.lanes.iter().map(|&lane| self.source.roads.lane(lane)).filter(|lane| lane.carries_cars);
        let lanes = for_cars.map(|lane| lane.id.clone()).collect();
        self.exits.push(Exit { edge: edge.id.clone(), lanes, ways });
    }

    /// Adds the light at the ends of the exits, if there is any.
    pub(super) fn finish(&mut self) -> Option<Gate> {
        let Gate { light, lanes } = &self.gate;
        if lanes.is_empty() {
            return None;
        }
        let green = "G".repeat(lanes.len());
        let phase = element("phase", &[("duration", "1000000"), ("state", &green)], Vec::new());
        let attributes = [("id", light.as_str()), ("type", "static"), ("programID", "0"), ("offset", "0")];
        self.elements.push(element("tlLogic", &attributes, vec![phase]));
        Some(self.gate.clone())
    }

    /// Copies the edges that follow `from`, called `name` here. `metres`: from the exit's end to the end of `from`.
    fn follow(&mut self, from: EdgeNo, name: &str, metres: f64, way: Way, ways: &mut Vec<Way>) {
        let next = self.next_edges(from);
        if next.is_empty() || way.copies.len() >= self.reach.hops || metres >= self.reach.metres {
            ways.push(way);
            return;
        }
        let begin = match way.copies.last() {
            Some(copy) => end_name(copy),
            None => self.source.end(from).attribute("id").expect("read as a junction before").to_owned(),
        };
        for edge in next {
            let id = self.source.roads.edge(edge).id.clone();
            let copied = self.free_name(format!("{name}+{id}"));
            self.copy(edge, &copied, &begin);
            self.connect(from, edge, [name, &copied], way.copies.is_empty());
            let length_m = self.length_m(edge);
            let mut way = way.clone();
            way.edges.push(id);
            way.copies.push(copied.clone());
            way.end_m = length_m.min(LAST_M);
            self.follow(edge, &copied, metres + length_m, way, ways);
        }
    }

    fn copy(&mut self, edge: EdgeNo, name: &str, begin: &str) {
        let end = end_name(name);
        let copied = copy(self.source.edges[edge.0], name, [begin, &end]);
        let lanes: Vec<&str> = copied.all("lane").filter_map(|lane| lane.attribute("id")).collect();
        let mut junction = dead_end(self.source.end(edge), |_| false);
        set(&mut junction, "id", &end);
        set(&mut junction, "incLanes", &lanes.join(" "));
        self.elements.extend([junction, copied]);
    }

    /// Connects two edges as they are in the whole net. Connections of an exit obey the gate.
    fn connect(&mut self, from: EdgeNo, to: EdgeNo, names: [&str; 2], is_exit: bool) {
        let roads = self.source.roads;
        for &number in self.source.links_from(from) {
            let link = &roads.connections[number];
            if roads.lane(link.to).edge != to {
                continue;
            }
            let letter = is_exit.then(|| self.letter(link.from));
            let gate = letter.map(|letter| (self.gate.light.as_str(), letter));
            self.elements.push(connection(self.source.connections[number], names, gate));
        }
    }

    fn letter(&mut self, lane: LaneNo) -> usize {
        let id = &self.source.roads.lane(lane).id;
        let lanes = &mut self.gate.lanes;
        lanes.iter().position(|known| known == id).unwrap_or_else(|| {
            lanes.push(id.clone());
            lanes.len() - 1
        })
    }

    fn next_edges(&self, from: EdgeNo) -> Vec<EdgeNo> {
        let roads = self.source.roads;
        let mut next = Vec::new();
        for lane in roads.edge(from).lanes.iter().flat_map(|&lane| roads.links_from(lane)).map(|link| link.to) {
            let edge = roads.lane(lane).edge;
            if roads.is_road(lane) && !next.contains(&edge) {
                next.push(edge);
            }
        }
        next
    }

    fn length_m(&self, edge: EdgeNo) -> f64 {
        self.source.roads.lane(self.source.roads.edge(edge).lanes[0]).length_m
    }

    fn free_name(&mut self, mut name: String) -> String {
        let is_taken = |name: &str| self.source.names.contains(name) || self.taken.contains(name);
        while is_taken(&name) || is_taken(&end_name(&name)) {
            name.push('+');
        }
        self.taken.insert(name.clone());
        name
    }
}

fn end_name(copy: &str) -> String {
    format!("{copy}+end")
}

fn element(name: &str, attributes: &[(&str, &str)], children: Vec<Element>) -> Element {
    let attributes = attributes.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect();
    Element { name: name.to_owned(), attributes, children }
}

/// Returns a junction as a dead end at which only some of its lanes end.
pub(super) fn dead_end(junction: &Element, is_left: impl Fn(&str) -> bool) -> Element {
    let lanes = junction.attribute("incLanes").unwrap_or_default().split_whitespace();
    let lanes = lanes.filter(|lane| is_left(lane)).collect::<Vec<_>>().join(" ");
    let mut end = junction.clone();
    end.children.retain(|child| child.name == "param");
    set(&mut end, "type", "dead_end");
    set(&mut end, "incLanes", &lanes);
    set(&mut end, "intLanes", "");
    end
}

/// Returns an edge under another name, between other junctions.
fn copy(edge: &Element, id: &str, [from, to]: [&str; 2]) -> Element {
    let mut copy = edge.clone();
    set(&mut copy, "id", id);
    set(&mut copy, "from", from);
    set(&mut copy, "to", to);
    // Edges and lanes of the opposite direction have no copies.
    copy.attributes.retain(|(key, _)| key != "bidi");
    for (index, lane) in copy.children.iter_mut().filter(|child| child.name == "lane").enumerate() {
        lane.children.retain(|child| child.name != "neigh");
        set(lane, "id", &format!("{id}_{index}"));
    }
    copy
}

/// Returns a connection between other edges, without the inside of its junction. `gate`: its light and letter.
fn connection(like: &Element, [from, to]: [&str; 2], gate: Option<(&str, usize)>) -> Element {
    const KEPT: [&str; 3] = ["fromLane", "toLane", "dir"];
    let mut connection = like.clone();
    connection.attributes.retain(|(key, _)| KEPT.contains(&key.as_str()));
    set(&mut connection, "from", from);
    set(&mut connection, "to", to);
    if let Some((light, letter)) = gate {
        set(&mut connection, "tl", light);
        set(&mut connection, "linkIndex", &letter.to_string());
    }
    set(&mut connection, "state", "M");
    connection
}

fn set(element: &mut Element, key: &str, value: &str) {
    match element.attributes.iter_mut().find(|(known, _)| known == key) {
        Some((_, old)) => *old = value.to_owned(),
        None => element.attributes.push((key.to_owned(), value.to_owned())),
    }
}
