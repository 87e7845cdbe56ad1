//! A local region as lanes: the approaches that an agent sees, the exits behind its light, and the links between them.

#[derive(Clone, Debug, PartialEq)]
pub struct RegionPlan {
    /// Lanes towards the stop lines, in the order of observations and of every array with one entry per approach.
    pub approaches: Vec<Approach>,
    pub exits: Vec<Exit>,
    /// Ways through the intersection under the light. Several may share a letter of the light's state.
    pub links: Vec<Link>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Approach {
    pub lane: String,
    pub length_m: f64,
    pub speed_limit_mps: f64,
    /// Distance from the end of the lane to the stop line: more than 0 behind an uncontrolled junction.
    pub ahead_m: f64,
    /// Links that cars on this lane can come to, as indices into [`RegionPlan::links`].
    pub links: Vec<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Exit {
    pub lane: String,
    pub length_m: f64,
    pub(crate) speed_limit_mps: f64,
    /// Whether cars on it leave the net without coming to another light or, at once, to this one again.
    pub leaves_the_net: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Link {
    /// Index of its letter in the light's state: SUMO's `linkIndex`.
    pub letter: usize,
    /// Index into [`RegionPlan::approaches`] of the lane that ends at the stop line.
    pub from: usize,
    pub to: usize,
    /// Its lanes within the junction, if masks mind the cars that are [trapped](super::trapped) there.
    pub inside: Vec<String>,
    /// Links whose ways cross its own there, as indices into [`RegionPlan::links`]; none if nobody minds.
    pub crosses: Vec<usize>,
}
