//! Cars on their way in, and what happened in a step.

use super::ids::{CarId, RouteId};

/// A car that shall enter in the next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Insertion {
    /// Becomes the car's name: below 2^63, and of no other car that waits or drives.
    pub car: u64,
    pub route: RouteId,
    /// Of the front bumper, from the beginning of the route's first edge. Beyond its end SUMO takes the end.
    pub position_m: f64,
    pub speed: DepartSpeed,
}

/// How fast an inserted car begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepartSpeed {
    /// As fast as the lane and the car in front allow, so that it rarely has to wait.
    Max,
    /// In metres per second; it waits until that is safe.
    Fixed(f64),
}

/// A car that entered in the last step, with all that it takes to let the same car enter again.
#[derive(Clone, Debug, PartialEq)]
pub struct Departure {
    pub id: CarId,
    pub name: String,
    pub vehicle_type: String,
    pub route: String,
    /// Of the route.
    pub edges: Vec<String>,
    /// Index on the route's first edge.
    pub lane: u32,
    /// As in [`super::Car`], like the speed: where it was put, for it has not moved yet.
    pub position_m: f64,
    pub speed_mps: f64,
    /// What its desired speed is of the limit; drawn by SUMO where the vehicle type leaves a choice.
    pub speed_factor: f64,
}

/// What happened in the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepCounts {
    /// Cars that entered.
    pub departed: u32,
    /// Cars that reached the end of their route; removed ones are not among them.
    pub arrived: u32,
    /// Cars that wanted to enter and still wait.
    pub pending: u32,
    /// Teleports that began.
    pub teleports: u32,
    /// Collisions that began.
    pub collisions: u32,
    /// Cars that SUMO halted on the spot because their way ended, in its own words "emergency stops". A car that brakes
    /// harder than its `decel`, as before a light that jumps to red, is none (measured on SUMO 1.15).
    pub emergency_stops: u32,
}
