//! Cars that enter, and what happened in a step.

use super::ids::{CarId, LaneId, RouteId, TypeId};

/// A car to insert in the next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Insertion {
    /// Number that becomes the car's name: below 2^63, and of no other car that waits or drives.
    pub car: u64,
    pub route: RouteId,
    /// Position of the front bumper, from the beginning of the route's first edge. SUMO takes the edge's end for
    /// anything beyond it.
    pub position_m: f64,
    pub speed: DepartSpeed,
}

/// A car of any type to insert in the next step, on any lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entering {
    pub insertion: Insertion,
    pub vehicle_type: TypeId,
    /// Index of the lane on the route's first edge. `None`: the first one that it may use.
    pub lane: Option<u32>,
    /// Desired speed as a share of the limit.
    pub speed_factor: f64,
    /// Position on the route's last edge at which the car has arrived. `None`: its end.
    pub end_m: Option<f64>,
}

/// The place and speed that a car gets which was to enter, whoever is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placing {
    /// Number of the car.
    pub car: u64,
    /// Lane of its route, or between two roads of it.
    pub lane: LaneId,
    /// Position of the front bumper, from the lane's beginning.
    pub position_m: f64,
    pub speed_mps: f64,
}

/// The speed at which an inserted car begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepartSpeed {
    /// The speed that the lane and the car in front allow, so that the car rarely has to wait.
    Max,
    /// A speed in metres per second. The car waits until it is safe.
    Fixed(f64),
}

/// A car that entered in the last step, with all data needed to let the same car enter again.
#[derive(Clone, Debug, PartialEq)]
pub struct Departure {
    pub id: CarId,
    pub name: String,
    pub vehicle_type: String,
    /// SUMO's class of its type, such as `passenger`.
    pub vehicle_class: String,
    pub route: String,
    /// Edges of the route.
    pub edges: Vec<String>,
    /// Index of the lane on the route's first edge.
    pub lane: u32,
    /// Position as in [`super::Car`], like the speed. It is where the car was put, because it has not moved yet.
    pub position_m: f64,
    pub speed_mps: f64,
    /// Desired speed as a share of the limit. SUMO draws it if the vehicle type leaves a choice.
    pub speed_factor: f64,
}

/// The route of a car at some time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RouteNow {
    /// Edges, also those behind the car.
    pub edges: Vec<String>,
    /// Index of the edge on which the car is. In a junction it is that of the edge before.
    pub at: usize,
}

/// The counts of the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepCounts {
    /// Number of cars that entered.
    pub departed: u32,
    /// Number of cars that reached the end of their route, without removed ones.
    pub arrived: u32,
    /// Number of cars that wanted to enter and still wait.
    pub pending: u32,
    /// Number of teleports that began.
    pub teleports: u32,
    /// Number of collisions that began.
    pub collisions: u32,
    /// Number of cars that SUMO halted on the spot because their way ended; SUMO calls them "emergency stops". A car
    /// that brakes harder than its `decel`, as before a light that jumps to red, does not count (measured on SUMO
    /// 1.15).
    pub emergency_stops: u32,
}
