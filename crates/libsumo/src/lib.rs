//! SUMO behind a safe interface: the one simulation of this process, and the questions it answers.
//!
//! Everything here is about roads in general: lanes, lights, routes, cars. This room does not know what an agent or a
//! region is, and no code outside sees a C pointer or a C++ exception.
//!
//! A [`Simulation`] is a guard. libsumo keeps its state in globals, so there is one simulation per process. Only the
//! holder of the guard can call it. Lanes, lights, routes and types are *registered* once by name and are numbers from
//! then on. A car is a number too ([`CarId`]), because names of thousands of cars per step would cost more than the
//! step. Only its [`Departure`] has a car's name.
//!
//! From top to bottom: [`Simulation`] in `simulation` (meaning, checks) -> `call` (the only `unsafe`) -> `ffi` (made by
//! bindgen) -> `shim/dials_sumo.cpp` (C++ in, plain C out) -> `shim/late.S` (functions that are found late) -> libsumo.
//! `library` loads libsumo when it is first needed.
//!
//! Types of this interface: `ids` (lanes, lights, routes, types, cars), `table` (cars by lane), `events` (cars that enter, and
//! counts of a step), `signal` (states of lights), `error` (why SUMO refused).

mod call;
mod error;
mod events;
mod ffi;
mod ids;
mod library;
mod signal;
mod simulation;
mod table;

pub use error::{Error, Result};
pub use events::{DepartSpeed, Departure, Entering, Insertion, Placing, RouteNow, StepCounts};
pub use ids::{CarId, LaneId, LightId, RouteId, TypeId};
pub use library::load;
pub use signal::SignalState;
pub use simulation::Simulation;
pub use table::{Car, CarTable, LaneCars};
