//! What an agent is: pure, without SUMO's simulation and without files.
//!
//! - [`region`]: the shape of a local region.
//! - [`phases`]: what the light of an intersection can show.

pub mod phases;
pub mod region;
