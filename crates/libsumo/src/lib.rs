#![doc = include_str!("../README.md")]
#![warn(missing_docs, unreachable_pub)]

// From top to bottom: `simulation` (meaning, checks) -> `call` (the crossing to C) -> `ffi` (made by bindgen) -> `shim/shim.cpp`
// (C++ in, plain C out) -> `shim/late.h` (functions that are found by name) -> libsumo, which `library` opens at one of the `places`.
// Around every call: `guard` -> `shim/guard.cpp`, which speaks when SUMO dies or never comes back.
// Past the interface: `shortcuts` -> `shim/inside.h`, `shim/detours.cpp`.
// Types of this interface: `ids`, `table` (cars by lane), `events` (cars that enter, counts of a step), `signal`, `version`, `error`.
mod call;
mod error;
mod events;
mod faults;
mod ffi;
mod guard;
mod ids;
mod library;
mod places;
pub mod shortcuts;
mod signal;
mod simulation;
mod stand_ins;
mod table;
mod version;

pub use error::{Error, Result};
pub use events::{DepartSpeed, Departure, Entering, Insertion, Placing, RouteNow, StepCounts};
pub use guard::Limits;
pub use ids::{CarId, EdgeId, LaneId, LightId, RouteId, TypeId};
pub use library::{Library, load, variable_for_children};
pub use places::{Place, places, program};
pub use signal::SignalState;
pub use simulation::Simulation;
pub use table::{Car, CarTable, LaneCars};
pub use version::Version;
