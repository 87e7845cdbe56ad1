//! The net of one light, cut out of a larger one.

use std::io;

use serde::{Deserialize, Serialize};

use super::names::write;
use crate::network::tree::Element;
use crate::network::xml::{Xml, document_with};

/// The net of one light. It keeps the names, shapes, rights of way and programs of the net that it was cut out of.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LocalNet {
    pub(crate) light: String,
    /// Lanes for cars on the edges that begin at the border.
    pub(crate) entry_lanes: Vec<String>,
    pub exits: Vec<Exit>,
    /// Light at the ends of the exits. `None`: all exits are dead ends.
    pub gate: Option<Gate>,
    pub(super) root: Element,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exit {
    pub(crate) edge: String,
    pub lanes: Vec<String>,
    /// Ways behind it, at least one. A route goes over one of them to its end, or ends earlier.
    pub ways: Vec<Way>,
}

/// A way behind an exit. Cars choose their lanes by it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Way {
    /// Edges of the whole net, the nearest first. Empty: the exit is a dead end.
    pub(crate) edges: Vec<String>,
    /// Copies of these edges in the local net. No other exit leads to them.
    pub copies: Vec<String>,
    /// Position on the last edge at which a car has arrived, in metres.
    pub(crate) end_m: f64,
}

/// A light of our own at the ends of exit lanes. It always shows green. Red blocks an exit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gate {
    pub light: String,
    pub lanes: Vec<String>,
}

/// Kinds of elements that only one region has, in the order that SUMO needs. Others are common to all regions.
pub(super) const KINDS: [&str; 6] = ["edge", "tlLogic", "junction", "connection", "roundabout", "route"];

impl LocalNet {
    /// Returns all lanes in the order in which SUMO loads them, those within junctions included.
    pub fn lanes(&self) -> impl Iterator<Item = &str> {
        let lanes = self.root.all("edge").flat_map(|edge| edge.all("lane"));
        lanes.map(|lane| lane.attribute("id").expect("read as a lane before"))
    }

    pub(crate) fn leads(&self, from: &str, to: &str) -> bool {
        let is_it =
            |connection: &Element| connection.attribute("from") == Some(from) && connection.attribute("to") == Some(to);
        self.root.all("connection").any(is_it)
    }

    pub(crate) fn root(&self) -> &Element {
        &self.root
    }
}

/// Returns the text of a file with the elements of these ones side by side, each with its prefix before every name.
/// `more` writes further elements of a kind.
pub(super) fn side_by_side(roots: &[(String, &Element)], more: impl Fn(&mut Xml, &str) -> io::Result<()>) -> String {
    let (_, one) = roots[0];
    document_with(&one.name, one.attributes.iter().map(|(key, value)| (key, value)), |xml| {
        let mut shared = one.children.iter().filter(|element| !KINDS.contains(&&*element.name));
        shared.try_for_each(|element| write(xml, element, ""))?;
        for kind in KINDS {
            for (prefix, root) in roots {
                root.all(kind).try_for_each(|element| write(xml, element, prefix))?;
            }
            more(xml, kind)?;
        }
        Ok(())
    })
}
