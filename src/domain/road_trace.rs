//! Cars and lights on roads in an episode, second by second, for pictures. Has no simulator's types or names.

/// An episode on a grid of roads. Lists of intersections are in the order of the agents.
#[derive(Clone, Debug, PartialEq)]
pub struct RoadTrace {
    /// Number of steps, each of a second.
    pub seconds: usize,
    /// Number of rows of intersections, and of columns. Agents are numbered row by row from the south-west corner,
    /// eastwards and then northwards.
    pub rows: usize,
    pub columns: usize,
    /// Names of the intersections.
    pub names: Vec<String>,
    /// Directions that a light can give green to, in words for a legend.
    pub greens: Vec<&'static str>,
    /// State of the light of each intersection in each second.
    pub lights: Vec<Vec<Shown>>,
    pub approaches: Vec<Approach>,
    pub corridors: Vec<Corridor>,
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

/// The approaches of all intersections from one side.
#[derive(Clone, Debug, PartialEq)]
pub struct Approach {
    /// Side, such as `west`.
    pub from: &'static str,
    /// Number of standing cars, `[intersections][seconds]`.
    pub standing: Vec<Vec<usize>>,
}

/// A row of intersections that cars drive through from one end to the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Corridor {
    /// Name, such as `row 1 of a grid of 2x2`.
    pub name: String,
    /// Sides where the corridor begins and ends, such as `west`, `east`.
    pub from: &'static str,
    pub to: &'static str,
    pub length_m: f64,
    pub crossings: Vec<CorridorLight>,
    /// Points of each car: seconds, and metres from the beginning.
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
    /// Returns rows and columns, such as `2x3`.
    pub fn grid(&self) -> String {
        format!("{}x{}", self.rows, self.columns)
    }
}
