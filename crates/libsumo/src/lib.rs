#![doc = include_str!("../README.md")]
#![warn(missing_docs, unreachable_pub)]

// From top to bottom: `simulation` (meaning, checks) -> `call` (the only `unsafe`, beside `library`) -> `ffi` (made by bindgen)
// -> `shim/shim.cpp` (C++ in, plain C out) -> `shim/late.S` (functions that are found late) -> libsumo, loaded by `library`.
// Types of this interface: `ids`, `table` (cars by lane), `events` (cars that enter, counts of a step), `signal`, `error`.
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
