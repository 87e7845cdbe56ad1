//! The border of a local region of a scenario: where cars come in and go out, and what its AIP predicts of it.
//!
//! A region has *entries* and *exits*. An entry is a lane that begins at the border, or a road in the region on which
//! cars depart. A car *arrives* in a second if it is on the region after it and was not before it, or if it came to a
//! road that begins at the border: two roads of a region may meet outside of it. An exit is a lane
//! that ends at the border and leads on. It is *blocked* while its first car is within [`BLOCK_M`] of its end and slower
//! than [`BLOCK_MPS`], and while the light at its end lets nobody on.
//!
//! The influence sources of a decision are bits in this order:
//! 1. for each entry, one bit per second of the decision: does a car arrive? There is at most one arrival per entry and
//!    second: a second car counts in the next second.
//! 2. for each exit, one bit per [`PART_S`] seconds: is it blocked in any of them?
//!
//! A local simulator lets a car in for each arrival, and shows red at the end of each blocked exit.
//!
//! # Why not otherwise
//!
//! **Why not a bit for each second?** A predictor draws bits one by one, so the light at an exit would flicker more. It is not
//! more like the global simulator either.
//!
//! **Why not one for the whole decision?** Cars would leave a jam too early or too late by seconds, again and again. Of 79
//! lights on two busy maps of others and the shipped ones, the local simulators of 73 could be trusted (`check --sigma 0`). With
//! a bit for each second these were 72. With one for the decision, and one road behind exits, 66.

use std::ops::Range;

use crate::network::roads::Signal;
use crate::network::roads::carries::Classes;

/// Distance from the end of an exit within which a slow car blocks it, in metres.
pub const BLOCK_M: f64 = 20.0;
/// Speed below which a car is slow, in metres per second. Before a full road cars crawl rather than stand.
pub const BLOCK_MPS: f64 = 2.0;
/// Seconds of a part of a decision. In each part an exit is blocked or not.
pub const PART_S: usize = 2;

#[derive(Clone, Debug, PartialEq)]
pub struct BorderPlan {
    /// Roads of the region, in the order of the file.
    pub roads: Vec<BorderRoad>,
    /// Lanes of the region for cars: of its roads, then within its junctions, each in the order of the file.
    pub lanes: Vec<BorderLane>,
    /// Lanes that begin at the border, then roads on which cars depart.
    pub entries: Vec<Entry>,
    /// Lanes that end at the border and lead on, as indices into [`BorderPlan::lanes`].
    pub exits: Vec<usize>,
    /// Signals at the end of each exit. Empty: from there a car may go on without one.
    pub(crate) exit_signals: Vec<Vec<Signal>>,
    pub decision_s: usize,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BorderRoad {
    pub road: String,
    pub begins_outside: bool,
    pub(crate) ends_outside: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub struct BorderLane {
    pub lane: String,
    /// Its road, an index into [`BorderPlan::roads`]. `None`: it is within a junction.
    pub(crate) road: Option<usize>,
    pub length_m: f64,
    pub(crate) classes: Classes,
    /// Entry that a car has passed which is first seen here. `None`: no entry is near enough.
    pub entry: Option<usize>,
    /// Entry of a car that departs here.
    pub departures: Option<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub(crate) place: EntryPlace,
    /// Way of a car of which nothing is known, along the first connections, to the first road behind the region.
    pub(crate) default_way: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum EntryPlace {
    /// At the beginning of this lane, an index into [`BorderPlan::lanes`].
    Lane(usize),
    /// On this road, where they depart: SUMO's name.
    Road(String),
}

impl BorderPlan {
    /// Returns whether a car that was on one lane of the region and is on another has come over the border.
    pub(crate) fn is_over_the_border(&self, from: usize, to: usize) -> bool {
        let road = self.lanes[to].road;
        road != self.lanes[from].road && road.is_some_and(|road| self.roads[road].begins_outside)
    }

    pub fn sources(&self) -> usize {
        self.entries.len() * self.decision_s + self.exits.len() * self.parts()
    }

    pub fn arrival(&self, entry: usize, second: usize) -> usize {
        entry * self.decision_s + second
    }

    /// Returns the part of a decision in which a second of it lies.
    pub fn part_of(&self, second: usize) -> usize {
        second / PART_S
    }

    pub fn parts(&self) -> usize {
        self.decision_s.div_ceil(PART_S)
    }

    pub fn blocked(&self, exit: usize, part: usize) -> usize {
        self.entries.len() * self.decision_s + exit * self.parts() + part
    }

    /// Returns the signals at the end of an exit: their lights and letters. None: a car may go on without one.
    pub fn exit_signals(&self, exit: usize) -> Vec<(&str, usize)> {
        self.exit_signals[exit].iter().map(|signal| (&*signal.light, signal.letter)).collect()
    }

    pub fn all_blocked(&self) -> Range<usize> {
        self.blocked(0, 0)..self.blocked(self.exits.len(), 0)
    }

    pub(crate) fn road_of_entry(&self, entry: usize) -> &str {
        &self.entries[entry].default_way[0]
    }

    pub(crate) fn is_on_road(&self, lane: usize, road: &str) -> bool {
        self.lanes[lane].road.is_some_and(|number| self.roads[number].road == road)
    }

    /// Returns the lane on which a vehicle of a class can begin at an entry: on a road, the first that it may use.
    pub(crate) fn lane_of_entry(&self, entry: usize, class: &str) -> Option<usize> {
        let is_open = |&lane: &usize| self.lanes[lane].classes.has(class);
        match &self.entries[entry].place {
            EntryPlace::Lane(lane) => Some(*lane).filter(is_open),
            EntryPlace::Road(road) => (0..self.lanes.len()).filter(|&lane| self.is_on_road(lane, road)).find(is_open),
        }
    }

    pub fn entry_name(&self, entry: usize) -> String {
        match &self.entries[entry].place {
            EntryPlace::Lane(lane) => self.lanes[*lane].lane.clone(),
            EntryPlace::Road(road) => format!("departures on {road}"),
        }
    }

    pub fn source_names(&self) -> Vec<String> {
        let arrivals = (0..self.entries.len()).flat_map(|entry| {
            let name = self.entry_name(entry);
            (0..self.decision_s).map(move |second| format!("arrival {name}[{second}]"))
        });
        let exits = self.exits.iter().map(|&lane| &self.lanes[lane].lane);
        let blocked = exits.flat_map(|exit| (0..self.parts()).map(move |part| format!("blocked {exit}[{part}]")));
        arrivals.chain(blocked).collect()
    }
}
