//! What a net is: junctions, edges with their lanes, connections, and the programs of its lights.
//!
//! Made of the elements of a `.net.xml` by `read`, or of a whole file by [`file`]. Numbers and names are checked once
//! there, so that everything else may rely on them.
//!
//! - `attributes`: numbers and names out of an element, with errors that name element and attribute. `shape`: lines.
//! - [`program`]: what lights show by themselves. `carries`: which lanes are for cars.
//! - `crossing`: which links of a light cross each other. `example`: a net for tests. `faults`: tests
//!   of nets with errors.

mod attributes;
pub(in crate::traffic) mod carries;
mod crossing;
#[cfg(test)]
pub(in crate::traffic) mod example;
#[cfg(test)]
mod faults;
pub mod file;
pub mod program;
mod read;
mod shape;

use std::collections::{BTreeSet, HashMap};

use carries::Classes;
use program::Program;

/// Number of a junction in [`Roads::junctions`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JunctionNo(pub usize);

/// Number of an edge in [`Roads::edges`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EdgeNo(pub usize);

/// Number of a lane in [`Roads::lanes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LaneNo(pub usize);

/// A place in the coordinates of the net, in metres.
pub type Place = [f64; 2];

/// A road network. Everything is in the order of its file.
#[derive(Clone, Debug, Default)]
pub struct Roads {
    pub junctions: Vec<Junction>,
    pub edges: Vec<Edge>,
    pub lanes: Vec<Lane>,
    pub connections: Vec<Connection>,
    /// Programs of the lights. A light may have several.
    pub programs: Vec<Program>,
    edge_numbers: HashMap<String, EdgeNo>,
    lane_numbers: HashMap<String, LaneNo>,
    /// Connections that begin at each lane, as indices into [`Roads::connections`].
    from_lane: Vec<Vec<usize>>,
    /// Connections that end at each lane, as indices into [`Roads::connections`].
    to_lane: Vec<Vec<usize>>,
    /// Connections that each light controls, as indices into [`Roads::connections`].
    of_light: HashMap<String, Vec<usize>>,
}

/// A place where edges meet. The inside of a large junction has junctions of its own, of kind `internal`.
#[derive(Clone, Debug)]
pub struct Junction {
    pub id: String,
    /// SUMO's type, such as `priority` or `traffic_light`.
    pub kind: String,
    pub place_m: Place,
    /// Outline; may be empty.
    pub shape: Vec<Place>,
    /// Lanes that end here, in SUMO's order. Empty for junctions inside of others.
    pub incoming: Vec<LaneNo>,
    /// Right of way of each link, in the order of [`Roads::links_of`].
    pub requests: Vec<Request>,
}

/// The right of way of one link of a junction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Whether this link yields to another one. One entry per link of the junction.
    pub yields_to: Vec<bool>,
    /// Whether this link crosses another one. One entry per link of the junction.
    pub crosses: Vec<bool>,
}

/// What an edge is: SUMO's attribute `function`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    Road,
    /// The inside of a junction.
    Internal,
    /// Way of pedestrians over a road.
    Crossing,
    /// Pavement at the corner of a junction.
    WalkingArea,
}

/// A road in one direction, or a part of a junction.
#[derive(Clone, Debug)]
pub struct Edge {
    pub id: String,
    pub function: Function,
    /// Junctions where a road begins and ends. Parts of a junction have none.
    pub ends: Option<[JunctionNo; 2]>,
    /// Lanes from the right to the left.
    pub lanes: Vec<LaneNo>,
}

/// A lane of an edge, or of the inside of a junction.
#[derive(Clone, Debug)]
pub struct Lane {
    pub id: String,
    pub edge: EdgeNo,
    pub length_m: f64,
    pub speed_limit_mps: f64,
    pub shape: Vec<Place>,
    /// Whether passenger cars or buses may drive here.
    pub carries_cars: bool,
    pub classes: Classes,
}

/// A way from one lane to the next.
#[derive(Clone, Debug)]
pub struct Connection {
    pub from: LaneNo,
    pub to: LaneNo,
    /// First lane within the junction.
    pub via: Option<LaneNo>,
    /// Light that controls it.
    pub signal: Option<Signal>,
    /// Whether it turns back into the opposite direction.
    pub turns_around: bool,
}

/// The letter of a light that a connection obeys.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signal {
    pub light: String,
    /// Index of the letter in the light's state: SUMO's `linkIndex`.
    pub letter: usize,
}

impl Roads {
    /// Makes a program that was loaded after the net the only one of its light, as SUMO makes it the one that runs. A light
    /// that the net does not have is left alone.
    pub fn replace_program(&mut self, program: Program) {
        let Some(place) = self.programs.iter().position(|earlier| earlier.light == program.light) else { return };
        let light = program.light.clone();
        self.programs[place] = program;
        let mut number = 0..;
        self.programs.retain(|other| number.next() == Some(place) || other.light != light);
    }

    pub fn junction(&self, junction: JunctionNo) -> &Junction {
        &self.junctions[junction.0]
    }

    pub fn edge(&self, edge: EdgeNo) -> &Edge {
        &self.edges[edge.0]
    }

    pub fn lane(&self, lane: LaneNo) -> &Lane {
        &self.lanes[lane.0]
    }

    /// Finds an edge by SUMO's name.
    pub fn edge_named(&self, id: &str) -> Option<EdgeNo> {
        self.edge_numbers.get(id).copied()
    }

    /// Finds a lane by SUMO's name.
    pub fn lane_named(&self, id: &str) -> Option<LaneNo> {
        self.lane_numbers.get(id).copied()
    }

    /// Returns the edges that are roads: those with two ends, not the insides of junctions.
    pub fn roads(&self) -> impl Iterator<Item = (EdgeNo, &Edge)> {
        let numbered = self.edges.iter().enumerate().map(|(number, edge)| (EdgeNo(number), edge));
        numbered.filter(|(_, edge)| edge.ends.is_some())
    }

    /// Returns the connections that begin at a lane, in the order of the file.
    pub fn from_lane(&self, lane: LaneNo) -> impl Iterator<Item = &Connection> {
        self.from_lane[lane.0].iter().map(|&number| &self.connections[number])
    }

    /// Returns the connections that end at a lane, in the order of the file.
    pub fn to_lane(&self, lane: LaneNo) -> impl Iterator<Item = &Connection> {
        self.to_lane[lane.0].iter().map(|&number| &self.connections[number])
    }

    /// Returns whether a lane is one of a road, and not within a junction.
    pub fn is_road(&self, lane: LaneNo) -> bool {
        self.edge(self.lane(lane).edge).function == Function::Road
    }

    /// Returns the junction where a lane of a road begins.
    pub fn begin_of(&self, lane: LaneNo) -> Option<JunctionNo> {
        self.edge(self.lane(lane).edge).ends.map(|[begin, _]| begin)
    }

    /// Returns the junction where a lane of a road ends.
    pub fn end_of(&self, lane: LaneNo) -> Option<JunctionNo> {
        self.edge(self.lane(lane).edge).ends.map(|[_, end]| end)
    }

    /// Returns whether cars can use a connection.
    pub fn carries_cars(&self, connection: &Connection) -> bool {
        self.lane(connection.from).carries_cars && self.lane(connection.to).carries_cars
    }

    /// Returns the connections that a light controls, in the order of the file. Some may be for people on foot.
    pub fn of_light(&self, light: &str) -> impl Iterator<Item = &Connection> {
        self.of_light.get(light).into_iter().flatten().map(|&number| &self.connections[number])
    }

    /// Returns the connections of cars that a light controls, in the order of the file.
    pub fn under_light(&self, light: &str) -> impl Iterator<Item = &Connection> {
        self.of_light(light).filter(|connection| self.carries_cars(connection))
    }

    /// Returns the letters of a light that cars obey.
    pub fn letters_of_cars(&self, light: &str) -> BTreeSet<usize> {
        self.under_light(light).filter_map(|link| Some(link.signal.as_ref()?.letter)).collect()
    }

    /// Returns the lanes of roads on which cars drive.
    pub fn lanes_of_cars(&self) -> impl Iterator<Item = LaneNo> {
        self.roads().flat_map(|(_, edge)| &edge.lanes).copied().filter(|&lane| self.lane(lane).carries_cars)
    }

    /// Returns the lanes of a connection within its junction, in the direction of driving.
    pub fn lanes_within_junction(&self, connection: &Connection) -> impl Iterator<Item = LaneNo> {
        let next = |&lane: &LaneNo| self.from_lane(lane).find_map(|connection| connection.via);
        // A way within a junction has one piece, or a few if cars wait on it. The bound ends rings in broken nets.
        std::iter::successors(connection.via, next).take(8)
    }

    /// Returns the length of a connection within its junction, in metres.
    pub fn length_within_junction(&self, connection: &Connection) -> f64 {
        self.lanes_within_junction(connection).map(|lane| self.lane(lane).length_m).sum()
    }
}
