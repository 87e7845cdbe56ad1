//! Cars that enter, and what happened in a step.

use super::ids::{CarId, LaneId, RouteId, TypeId};

/// A car of the vehicle type `car` to insert in the next step, on the first lane of its route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Insertion {
    /// Number that becomes the car's name: below 2^63, and of no other car that waits or drives.
    pub car: u64,
    /// Its route, which begins where it enters.
    pub route: RouteId,
    /// Position of the front bumper in metres, from the beginning of the route's first edge. SUMO takes the edge's end
    /// for anything beyond it.
    pub position_m: f64,
    /// Speed at which it begins.
    pub speed: DepartSpeed,
}

/// A car of any type to insert in the next step, on any lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entering {
    /// Its number, route, position and speed.
    pub insertion: Insertion,
    /// Its vehicle type, instead of `car`.
    pub vehicle_type: TypeId,
    /// Index of the lane on the route's first edge. `None`: the first one that it may use.
    pub lane: Option<u32>,
    /// Desired speed as a share of the speed limit: 1 is the limit.
    pub speed_factor: f64,
    /// Position in metres on the route's last edge at which the car has arrived. `None`: its end.
    pub end_m: Option<f64>,
}

/// A place and a speed for a car that waits to enter. It gets them whoever is there: [`Simulation::place`].
///
/// [`Simulation::place`]: crate::Simulation::place
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placing {
    /// Number of the car.
    pub car: u64,
    /// Lane of its route, or between two roads of it.
    pub lane: LaneId,
    /// Position of the front bumper in metres, from the lane's beginning.
    pub position_m: f64,
    /// Speed in metres per second.
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
    /// Its number.
    pub id: CarId,
    /// Its name in SUMO.
    pub name: String,
    /// Name of its vehicle type.
    pub vehicle_type: String,
    /// SUMO's class of its type, such as `passenger`.
    pub vehicle_class: String,
    /// Name of its route.
    pub route: String,
    /// Names of the route's edges.
    pub edges: Vec<String>,
    /// Index of the lane on the route's first edge.
    pub lane: u32,
    /// Position of the front bumper in metres, from the lane's beginning. It is where the car was put, because it has not
    /// moved yet.
    pub position_m: f64,
    /// Speed in metres per second.
    pub speed_mps: f64,
    /// Desired speed as a share of the speed limit. SUMO draws it if the vehicle type leaves a choice.
    pub speed_factor: f64,
}

/// The route of a car at some time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RouteNow {
    /// Names of its edges, also of those behind the car.
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
