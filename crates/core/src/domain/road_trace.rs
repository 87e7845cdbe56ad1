//! Cars and lights on roads in an episode, second by second, for pictures. Has no simulator's types.

use std::ops::Range;

/// A line in metres, east and north.
pub type Line = Vec<[f64; 2]>;

/// An episode on roads. Lists of intersections are in the order of the agents.
#[derive(Clone, Debug, PartialEq)]
pub struct RoadTrace {
    /// Seconds of the episode that the lists below are of.
    pub seconds: Range<usize>,
    pub layout: Layout,
    pub names: Vec<String>,
    /// Greens of the lights in words for a legend, such as the directions that they are for.
    pub greens: Vec<String>,
    /// State of the light of each intersection in each second.
    pub lights: Vec<Vec<Shown>>,
    pub approaches: Vec<Approach>,
    pub corridors: Vec<Corridor>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Layout {
    /// A grid. Agents are numbered row by row from the south-west corner, eastwards and then northwards.
    Grid { rows: usize, columns: usize },
    /// Any other network.
    Map(RoadMap),
}

#[derive(Clone, Debug, PartialEq)]
pub struct RoadMap {
    /// The network in words, such as `scenario town`.
    pub place: String,
    /// Outlines of the junctions; some may be empty.
    pub junctions: Vec<Line>,
    pub lanes: Vec<Line>,
    /// Places of the lights of the agents.
    pub lights_m: Vec<[f64; 2]>,
}

/// The state of an intersection's light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// Green for one of [`RoadTrace::greens`], by its index.
    Green(usize),
    Yellow,
    /// Anything else, such as red for all.
    Other,
}

/// The approaches from one side, of all intersections that have some.
#[derive(Clone, Debug, PartialEq)]
pub struct Approach {
    /// Side, such as `west`.
    pub from: &'static str,
    /// Number of standing cars, `[intersections][seconds]`.
    pub standing: Vec<Vec<usize>>,
}

/// A road that cars take from one end to the other, such as a row of intersections.
#[derive(Clone, Debug, PartialEq)]
pub struct Corridor {
    /// Name, such as `row 1 of a grid of 2x2`.
    pub name: String,
    /// Where the corridor begins and ends: sides such as `west`, `east`, or names of roads.
    pub from: String,
    pub to: String,
    pub length_m: f64,
    pub crossings: Vec<CorridorLight>,
    /// Trajectory of each car: seconds, and metres from the beginning.
    pub cars: Vec<Vec<(f64, f64)>>,
}

/// An intersection on a corridor.
#[derive(Clone, Debug, PartialEq)]
pub struct CorridorLight {
    pub name: String,
    /// Place where its inside begins, at the stop line, and where it ends, in metres from the beginning of the
    /// corridor.
    pub begin_m: f64,
    pub end_m: f64,
    /// Aspect that its light showed to the cars of the corridor in each second.
    pub aspects: Vec<Aspect>,
}

/// The colour that a light shows to one approach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aspect {
    Green,
    Yellow,
    Red,
}

impl RoadTrace {
    /// Returns the part of the trace from one of its seconds to another one.
    pub fn between(mut self, seconds: Range<usize>) -> RoadTrace {
        let first = self.seconds.start;
        fn cut<T>(list: &mut Vec<T>, Range { start, end }: Range<usize>) {
            list.truncate(end);
            list.drain(..start);
        }
        let within = seconds.start - first..seconds.end - first;
        self.lights.iter_mut().for_each(|shown| cut(shown, within.clone()));
        self.approaches.iter_mut().flat_map(|at| &mut at.standing).for_each(|queue| cut(queue, within.clone()));
        for corridor in &mut self.corridors {
            corridor.crossings.iter_mut().for_each(|crossing| cut(&mut crossing.aspects, within.clone()));
            let [begin, end] = [seconds.start, seconds.end].map(|second| second as f64);
            corridor.cars.iter_mut().for_each(|points| points.retain(|(second, _)| (begin..=end).contains(second)));
            corridor.cars.retain(|points| !points.is_empty());
        }
        RoadTrace { seconds, ..self }
    }

    /// Returns the place in words, such as `a grid of 2x3`.
    pub fn place(&self) -> String {
        match &self.layout {
            Layout::Grid { rows, columns } => format!("a grid of {rows}x{columns}"),
            Layout::Map(map) => map.place.clone(),
        }
    }
}
