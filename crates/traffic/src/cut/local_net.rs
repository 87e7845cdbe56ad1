//! The net of one light, cut out of a larger one.

use std::io;

use super::names::write;
use crate::network::tree::Element;
use crate::network::xml::{Xml, document_with};

/// The net of one light. It keeps the names, shapes, rights of way and programs of the net that it was cut out of.
#[derive(Clone, Debug)]
pub struct LocalNet {
    /// Light that it was cut out for.
    pub(crate) light: String,
    /// Lanes for cars on the edges that begin at the border.
    pub(crate) entry_lanes: Vec<String>,
    /// Edges that end at the border.
    pub exits: Vec<Exit>,
    /// Light at the ends of the exits. `None`: all exits are dead ends.
    pub gate: Option<Gate>,
    pub(super) parts: Parts,
}

/// An edge on which cars leave the region.
#[derive(Clone, Debug, PartialEq)]
pub struct Exit {
    pub(crate) edge: String,
    /// Lanes for cars.
    pub lanes: Vec<String>,
    /// Ways behind it, at least one. A route goes over one of them to its end, or ends earlier.
    pub ways: Vec<Way>,
}

/// A way behind an exit. Cars choose their lanes by it.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Edges of the whole net, the nearest first. Empty: the exit is a dead end.
    pub(crate) edges: Vec<String>,
    /// Copies of these edges in the local net. No other exit leads to them.
    pub copies: Vec<String>,
    /// Position on the last edge at which a car has arrived, in metres.
    pub(crate) end_m: f64,
}

/// A light of our own at the ends of exit lanes. It always shows green. Red blocks an exit.
#[derive(Clone, Debug, PartialEq)]
pub struct Gate {
    pub light: String,
    /// Lane of each letter of its state.
    pub lanes: Vec<String>,
}

/// Elements of a net.
#[derive(Clone, Debug, Default)]
pub(super) struct Parts {
    /// Attributes of the root.
    pub(crate) attributes: Vec<(String, String)>,
    /// Elements that nets of one source have in common: its place and its types of edges.
    pub(crate) shared: Vec<Element>,
    pub(crate) edges: Vec<Element>,
    pub(crate) lights: Vec<Element>,
    pub(crate) junctions: Vec<Element>,
    pub(crate) connections: Vec<Element>,
    pub(crate) roundabouts: Vec<Element>,
}

impl Parts {
    /// Number of kinds of elements in [`Parts::in_order`], and the places of two of them.
    pub(crate) const KINDS: usize = 5;
    pub(crate) const EDGES: usize = 0;
    pub(crate) const JUNCTIONS: usize = 2;

    /// Returns the elements that are not shared, by kind, in the order that SUMO needs.
    pub(super) fn in_order(&self) -> [&[Element]; Parts::KINDS] {
        [&self.edges, &self.lights, &self.junctions, &self.connections, &self.roundabouts]
    }
}

impl LocalNet {
    /// Returns all lanes in the order in which SUMO loads them, those within junctions included.
    pub fn lanes(&self) -> impl Iterator<Item = &str> {
        let lanes = self.parts.edges.iter().flat_map(|edge| edge.all("lane"));
        lanes.map(|lane| lane.attribute("id").expect("read as a lane before"))
    }

    /// Returns whether a lane of `from` leads to `to`.
    pub(crate) fn leads(&self, from: &str, to: &str) -> bool {
        let is_it =
            |connection: &Element| connection.attribute("from") == Some(from) && connection.attribute("to") == Some(to);
        self.parts.connections.iter().any(is_it)
    }

    /// Returns the root element of the net.
    pub(crate) fn root(&self) -> Element {
        let Parts { attributes, shared, .. } = &self.parts;
        let others = self.parts.in_order().concat();
        Element { name: "net".to_owned(), attributes: attributes.clone(), children: [&shared[..], &others].concat() }
    }

    /// Writes the elements of a kind, a place in [`Parts::in_order`], with a prefix before every name.
    pub(super) fn write_kind(&self, xml: &mut Xml, kind: usize, prefix: &str) -> io::Result<()> {
        self.parts.in_order()[kind].iter().try_for_each(|element| write(xml, element, prefix))
    }
}

/// Returns the text of a net of the elements that `fill` writes. `one`: a net that it is made of.
pub(super) fn net_text(one: &LocalNet, fill: impl FnOnce(&mut Xml) -> io::Result<()>) -> String {
    let Parts { attributes, shared, .. } = &one.parts;
    document_with("net", attributes.iter().map(|(key, value)| (key, value)), |xml| {
        shared.iter().try_for_each(|element| write(xml, element, ""))?;
        fill(xml)
    })
}
