//! Numbers for cars and for things registered by name.

/// A registered lane: [`Simulation::register_lanes`](crate::Simulation::register_lanes).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct LaneId(pub(crate) u32);

/// A registered traffic light: [`Simulation::register_lights`](crate::Simulation::register_lights).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct LightId(pub(crate) u32);

/// A registered route: [`Simulation::register_routes`](crate::Simulation::register_routes).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct RouteId(pub(crate) u32);

/// A registered vehicle type: [`Simulation::register_types`](crate::Simulation::register_types).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct TypeId(pub(crate) u32);

/// A registered edge: [`Simulation::register_edges`](crate::Simulation::register_edges).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct EdgeId(pub(crate) u32);

/// The number of a car.
///
/// It is the number under which the car was inserted, or the value of its decimal name. For a car with any other name (SUMO's
/// flows: `flow.17`; with zeros in front: `007`) it is the FNV-1a hash of the name, of 64 bits, with the top bit set. The same
/// name is the same number in every process. Two names could share a hash: among a million cars that has a chance of about
/// 1 in 20 million.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct CarId(pub u64);
