//! What a net is: junctions, edges with their lanes, connections, and the programs of its lights. `read` checks all
//! numbers and names once, so that everything else may rely on them.

pub(crate) mod attributes;
pub(crate) mod carries;
mod crossing;
#[cfg(test)]
pub(crate) mod example;
pub(crate) mod program;
mod read;

use std::collections::{BTreeSet, HashMap};

use anyhow::{Result, anyhow, ensure};

use crate::network::tree::Element;
use attributes::{tag, text};
use carries::Classes;
use dials_core::outside::{did_you_mean, excerpt};
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
pub(crate) type Place = [f64; 2];

/// A road network. Everything is in the order of its file.
#[derive(Clone, Debug, Default)]
pub struct Roads {
    pub junctions: Vec<Junction>,
    pub edges: Vec<Edge>,
    pub(crate) lanes: Vec<Lane>,
    pub(crate) connections: Vec<Connection>,
    /// Programs of the lights. A light may have several, in the order in which SUMO loads them. It runs the last one.
    pub programs: Vec<Program>,
    /// Lights whose programs are switched at set times, by a `<WAUT>` of another file.
    pub(crate) switched: BTreeSet<String>,
    edge_numbers: HashMap<String, EdgeNo>,
    lane_numbers: HashMap<String, LaneNo>,
    /// Connections that begin at each lane, as indices into [`Roads::connections`].
    from_lane: Vec<Vec<usize>>,
    /// Connections that end at each lane, as indices into [`Roads::connections`].
    to_lane: Vec<Vec<usize>>,
    /// Connections that each light controls, as indices into [`Roads::connections`].
    of_light: HashMap<String, Vec<usize>>,
}

/// A place where edges meet. The inside of a large junction has junctions of its own.
#[derive(Clone, Debug)]
pub struct Junction {
    pub id: String,
    pub place_m: Place,
    /// Outline; may be empty.
    pub shape: Vec<Place>,
    /// Lanes that end here, in SUMO's order. Empty for junctions inside of others.
    pub(crate) incoming: Vec<LaneNo>,
    /// Right of way of each link, in the order of [`Roads::links_of`].
    pub requests: Vec<Request>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Whether this link yields to another one. One entry per link of the junction.
    pub(crate) yields_to: Vec<bool>,
    /// Whether this link crosses another one. One entry per link of the junction.
    pub(crate) crosses: Vec<bool>,
}

/// What an edge is: SUMO's attribute `function`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    Road,
    Internal,
    /// Way of pedestrians over a road.
    Crossing,
    /// Pavement at the corner of a junction.
    WalkingArea,
}

/// A road in one direction, or a part of a junction.
#[derive(Clone, Debug)]
pub struct Edge {
    pub(crate) id: String,
    /// Name of the street. Many nets name only some.
    pub(crate) street: Option<String>,
    pub function: Function,
    /// Junctions where a road begins and ends. Parts of a junction have none.
    pub ends: Option<[JunctionNo; 2]>,
    /// Lanes from the right to the left.
    pub(crate) lanes: Vec<LaneNo>,
    /// Ids of the roads that a crossing leads across; empty for all other edges.
    pub(crate) crosses: Vec<String>,
}

impl Edge {
    /// Returns the name of its street, or its id if the street has none.
    pub(crate) fn name(&self) -> &str {
        self.street.as_deref().unwrap_or(&self.id)
    }
}

/// A lane of an edge, or of the inside of a junction.
#[derive(Clone, Debug)]
pub struct Lane {
    pub(crate) id: String,
    pub edge: EdgeNo,
    pub(crate) length_m: f64,
    pub(crate) speed_limit_mps: f64,
    pub shape: Vec<Place>,
    /// Whether passenger cars or buses may drive here.
    pub carries_cars: bool,
    /// Whether anything may drive here that drives on roads, such as bicycles.
    pub(crate) carries_vehicles: bool,
    pub(crate) classes: Classes,
}

#[derive(Clone, Debug)]
pub struct Connection {
    pub(crate) from: LaneNo,
    pub(crate) to: LaneNo,
    pub(crate) via: Option<LaneNo>,
    pub signal: Option<Signal>,
    /// Whether cars on it need not yield to anybody: SUMO's state `M`.
    pub(crate) has_priority: bool,
    /// SUMO's letter for where it leads: `l`, `s`, `r`, `t` and so on.
    pub(crate) direction: Option<char>,
}

impl Connection {
    pub(crate) fn turns_around(&self) -> bool {
        self.direction == Some('t')
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signal {
    pub(crate) light: String,
    /// Index of the letter in the light's state: SUMO's `linkIndex`.
    pub letter: usize,
}

impl Roads {
    /// Loads a `<tlLogic>` of another file after the net, as SUMO does. Without phases it is no program, but another offset
    /// for one. A program or an offset for a light that the net does not have is left alone.
    ///
    /// Errors: a state has fewer letters than its light has links.
    pub(crate) fn load_program(&mut self, element: &Element) -> Result<()> {
        if element.all("phase").next().is_none() && !program::needs_none(element) {
            let (light, id) = (text(element, "id")?, program::name(element));
            let known = self.programs.iter_mut().find(|program| program.light == light && program.id == id);
            if let Some(program) = known {
                program.offset_s = program::offset_s(element)?;
            }
            return Ok(());
        }
        let program = Program::read(element)?;
        let signals = self.of_light(&program.light).filter_map(|link| link.signal.as_ref());
        let links = signals.map(|signal| signal.letter + 1).max().unwrap_or(0);
        let letters = program.letters().unwrap_or(links);
        ensure!(
            letters >= links,
            "{}: its states have {letters} letters, but light `{}` has {links} links; give it one letter per link",
            tag(element),
            excerpt(&program.light)
        );
        if self.programs.iter().any(|earlier| earlier.light == program.light) {
            self.programs.push(program);
        }
        Ok(())
    }

    pub fn junction(&self, junction: JunctionNo) -> &Junction {
        &self.junctions[junction.0]
    }

    pub(crate) fn edge(&self, edge: EdgeNo) -> &Edge {
        &self.edges[edge.0]
    }

    /// Returns the outlines of the junctions that cars drive through; some may be empty.
    pub fn outlines(&self) -> Vec<Vec<Place>> {
        let driven = self.lanes_of_cars().filter_map(|lane| self.edge(self.lane(lane).edge).ends);
        let driven: BTreeSet<JunctionNo> = driven.flatten().collect();
        driven.into_iter().map(|junction| self.junction(junction).shape.clone()).collect()
    }

    pub fn lane(&self, lane: LaneNo) -> &Lane {
        &self.lanes[lane.0]
    }

    pub(crate) fn edge_named(&self, id: &str) -> Option<EdgeNo> {
        self.edge_numbers.get(id).copied()
    }

    /// Returns the road of this id. An error names a road that is called nearly so.
    pub(crate) fn edge_called(&self, id: &str) -> Result<EdgeNo> {
        let is_road = |edge: &EdgeNo| self.edge(*edge).ends.is_some();
        self.edge_named(id).filter(is_road).ok_or_else(|| {
            let near = did_you_mean(id, self.roads().map(|(_, edge)| &*edge.id));
            anyhow!("the net has no edge `{}`{near}; sumo-gui shows the ids of edges", excerpt(id))
        })
    }

    pub fn lane_named(&self, id: &str) -> Option<LaneNo> {
        self.lane_numbers.get(id).copied()
    }

    /// Returns the edges that are roads: those with two ends, not the insides of junctions.
    pub(crate) fn roads(&self) -> impl Iterator<Item = (EdgeNo, &Edge)> {
        let numbered = self.edges.iter().enumerate().map(|(number, edge)| (EdgeNo(number), edge));
        numbered.filter(|(_, edge)| edge.ends.is_some())
    }

    pub(crate) fn links_from(&self, lane: LaneNo) -> impl Iterator<Item = &Connection> {
        self.from_lane[lane.0].iter().map(|&number| &self.connections[number])
    }

    pub(crate) fn links_to(&self, lane: LaneNo) -> impl Iterator<Item = &Connection> {
        self.to_lane[lane.0].iter().map(|&number| &self.connections[number])
    }

    /// Returns whether a lane is one of a road, and not within a junction.
    pub(crate) fn is_road(&self, lane: LaneNo) -> bool {
        self.edge(self.lane(lane).edge).function == Function::Road
    }

    pub(crate) fn begin_of(&self, lane: LaneNo) -> Option<JunctionNo> {
        self.edge(self.lane(lane).edge).ends.map(|[begin, _]| begin)
    }

    pub fn end_of(&self, lane: LaneNo) -> Option<JunctionNo> {
        self.edge(self.lane(lane).edge).ends.map(|[_, end]| end)
    }

    pub(crate) fn carries_cars(&self, connection: &Connection) -> bool {
        self.lane(connection.from).carries_cars && self.lane(connection.to).carries_cars
    }

    /// Returns the names of the streets on which one comes to a light, each once.
    pub fn streets_to(&self, light: &str) -> Vec<&str> {
        let mut streets: Vec<&str> = Vec::new();
        for link in self.of_light(light) {
            let street = self.edge(self.lane(link.from).edge).street.as_deref();
            streets.extend(street.filter(|street| !streets.contains(street)));
        }
        streets
    }

    /// Returns the connections that a light controls, in the order of the file. Some may be for people on foot.
    pub(crate) fn of_light(&self, light: &str) -> impl Iterator<Item = &Connection> {
        self.of_light.get(light).into_iter().flatten().map(|&number| &self.connections[number])
    }

    /// Returns the connections of cars that a light controls, in the order of the file.
    pub fn under_light(&self, light: &str) -> impl Iterator<Item = &Connection> {
        self.of_light(light).filter(|connection| self.carries_cars(connection))
    }

    /// Returns the letters of a light that anything obeys that drives on roads, such as cars and bicycles.
    pub fn letters_of_vehicles(&self, light: &str) -> BTreeSet<usize> {
        let drives = |lane: LaneNo| self.lane(lane).carries_vehicles;
        let links = self.of_light(light).filter(|link| drives(link.from) && drives(link.to));
        links.filter_map(|link| Some(link.signal.as_ref()?.letter)).collect()
    }

    pub fn lanes_of_cars(&self) -> impl Iterator<Item = LaneNo> {
        self.roads().flat_map(|(_, edge)| &edge.lanes).copied().filter(|&lane| self.lane(lane).carries_cars)
    }

    /// Returns the lanes of a connection within its junction, in the direction of driving.
    pub(crate) fn lanes_within_junction(&self, connection: &Connection) -> impl Iterator<Item = LaneNo> {
        let next = |&lane: &LaneNo| self.links_from(lane).find_map(|connection| connection.via);
        // A way within a junction has one piece, or a few if cars wait on it. The bound ends rings in broken nets.
        std::iter::successors(connection.via, next).take(8)
    }

    pub(crate) fn length_within_junction(&self, connection: &Connection) -> f64 {
        self.lanes_within_junction(connection).map(|lane| self.lane(lane).length_m).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::example::{changed, roads};
    use super::*;
    use crate::network::tree::parse;

    fn load(roads: &mut Roads, element: &str) -> Result<()> {
        roads.load_program(&parse(element).unwrap())
    }

    #[test]
    fn an_entry_without_phases_is_another_offset_for_a_program() {
        let mut roads = roads(&[]);
        load(&mut roads, r#"<tlLogic id="J" programID="1"><phase duration="9" state="GGrr"/></tlLogic>"#).unwrap();
        load(&mut roads, r#"<tlLogic id="J" offset="12"/>"#).unwrap();
        let known: Vec<(&str, f64)> =
            roads.programs.iter().map(|program| (program.id.as_str(), program.offset_s)).collect();
        assert_eq!(known, [("0", 12.0), ("1", 0.0)]);
        load(&mut roads, r#"<tlLogic id="K" offset="12"/>"#).unwrap();
        assert_eq!(roads.programs.len(), 2);
    }

    #[test]
    fn a_program_of_another_file_has_a_letter_for_every_link() {
        let program = |light: &str, state: &str| {
            format!(r#"<tlLogic id="{light}" programID="1"><phase duration="9" state="{state}"/></tlLogic>"#)
        };
        let mut roads = roads(&[]);
        assert_eq!(
            load(&mut roads, &program("J", "GGr")).unwrap_err().to_string(),
            "<tlLogic id=\"J\">: its states have 3 letters, but light `J` has 4 links; give it one letter per link"
        );
        load(&mut roads, &program("K", "G")).unwrap();
        assert_eq!(roads.programs.len(), 1, "the net has no light K");
        // SUMO takes states with more letters, too.
        load(&mut roads, &program("J", "GGrrr")).unwrap();
        assert_eq!(roads.programs.len(), 2);
        let within = format!("</tlLogic>{}", program("J", "GGr"));
        assert!(Roads::read(&parse(&changed(&[("</tlLogic>", &within)])).unwrap()).is_err(), "in the net itself, too");
    }
}
