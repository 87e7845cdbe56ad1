//! What is on the roads of one light now: more than its observation shows. For observations and rewards that a user of
//! the library defines.

use serde::Serialize;

/// An intersection with its light.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RoadView {
    /// Index of the green that is shown, or that comes next.
    pub green: usize,
    /// Whether yellow or red for all is shown, between two greens.
    pub between: bool,
    /// Number of seconds for which the light has shown what it shows.
    pub shown_s: u32,
    /// Lanes to the stop lines, in the order of observations.
    pub approaches: Vec<ApproachView>,
}

/// A lane on which cars come to the light.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ApproachView {
    /// SUMO's name of the lane.
    pub lane: String,
    pub length_m: f64,
    pub speed_limit_mps: f64,
    /// Distance from the end of the lane to the stop line, along the lanes between them.
    pub ahead_m: f64,
    /// Cars, the rearmost first.
    pub cars: Vec<CarView>,
}

/// A car on an approach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CarView {
    /// Distance of its front from the beginning of the lane.
    pub position_m: f64,
    pub speed_mps: f64,
    /// Number of seconds for which it has stood on the approaches of this light.
    pub waited_s: u32,
}
