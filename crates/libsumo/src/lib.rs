#![doc = include_str!("../README.md")]
//!
//! # One simulation per process
//!
//! libsumo keeps its simulation in global variables, so a process has room for one. A [`Simulation`] is the guard of that
//! room: only its holder can call SUMO, and dropping it closes SUMO. Who needs several at a time starts several processes, or
//! puts several networks side by side into one net. No other libsumo may be in the process, such as one that a Python package
//! has loaded: they would not share the guard.
//!
//! # Threads
//!
//! A [`Simulation`] stays in the thread that loaded it: it is neither `Send` nor `Sync`. Other threads may call
//! [`Simulation::load`] at the same time, and wait there until it is dropped. [`Simulation::version`] and [`load`] wait for
//! nobody. While SUMO is called, what other C++ code writes to `std::cerr` and `std::cout` is swallowed; Rust's own
//! output is not.
//!
//! # Handles, not names
//!
//! Lanes, lights, routes and vehicle types are *registered* once by name, and are numbers from then on: [`LaneId`],
//! [`LightId`], [`RouteId`], [`TypeId`]. An id belongs to its simulation and to no other. A name that the net does not have is an
//! error when it is registered, and not in the middle of a run.
//!
//! A car (any vehicle of SUMO) is a number, too: [`CarId`]. The names of thousands of cars in every step would cost
//! more than the step. Only its [`Departure`] has a car's name.
//!
//! # What is loaded when
//!
//! SUMO's library brings 220 others. Nothing links it. It is loaded by the first call that needs it, or by [`load`]. So a
//! program starts fast, and without SUMO it still starts: the first call then returns [`Error::Library`] and says what to
//! do. Building takes SUMO's headers, its library and a C++ compiler. Tried with SUMO 1.15 on Linux and x86-64. On other
//! processors libsumo is linked as usual.
//!
//! # Errors
//!
//! SUMO throws, and prints the reason to the terminal. Here both become one [`Error`] with SUMO's words in one line; SUMO
//! itself is silent. A step that fails leaves a simulation that nobody can trust: every later call but
//! [`Simulation::reload`] is then an error, too. What SUMO would misread without a word is refused before it gets
//! there: unknown letters in the state of a light, a state of another length, a speed that is not a number.
//!
//! # Units
//!
//! Metres, seconds, metres per second; names say so (`position_m`, `speed_mps`).

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
