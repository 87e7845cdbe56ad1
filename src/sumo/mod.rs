//! SUMO, closed off: the one simulation of this process, and what may be asked of it.
//!
//! Everything here is about roads in general: lanes, lights, routes, cars. It does not know what an agent or a region
//! is, and nobody outside sees a C pointer or a C++ exception. A [`Simulation`] is a guard: libsumo keeps its state in
//! globals, so there is one per process, and whoever holds the guard holds the right to speak to it. Lanes, lights and
//! routes are *registered* once by name and are numbers from then on; a car is a number too ([`CarId`]), because names of
//! thousands of cars per step would cost more than the step. Only its [`Departure`] tells a car's name.
//!
//! The way down: [`Simulation`] (meaning, checks) -> `call` (the only `unsafe`) -> `ffi` (made by bindgen) ->
//! `shim/dials_sumo.cpp` (C++ in, plain C out) -> libsumo.
//!
//! What is handed over: `ids` (lanes, lights, routes, cars), `table` (cars by lane), `events` (cars that enter, and what a step
//! did), `signal` (what a light shows), `error` (why SUMO refused).

mod call;
mod error;
mod events;
mod ffi;
mod ids;
mod signal;
mod simulation;
mod table;

pub use error::{Error, Result};
pub use events::{DepartSpeed, Departure, Insertion, StepCounts};
pub use ids::{CarId, LaneId, LightId, RouteId};
pub use signal::SignalState;
pub use simulation::Simulation;
pub use table::{Car, CarTable, LaneCars};
