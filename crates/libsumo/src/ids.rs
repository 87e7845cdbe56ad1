//! Numbers for cars and for things registered by name.

/// A registered lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct LaneId(pub(super) u32);

/// A registered traffic light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct LightId(pub(super) u32);

/// A registered route.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct RouteId(pub(super) u32);

/// A registered vehicle type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct TypeId(pub(super) u32);

/// The identity of a car: the serial under which it was inserted, or the value of its decimal name. For a car with any
/// other name (SUMO's flows: `flow.17`; with zeros in front: `007`) it is the FNV-1a hash of the name with the top bit set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct CarId(pub u64);
