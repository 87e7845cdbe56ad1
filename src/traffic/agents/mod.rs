//! What an agent is. Pure: no SUMO simulation and no files.
//!
//! - [`region`]: the shape of a local region.
//! - [`phases`]: the phases that the light of an intersection can show.

pub mod phases;
pub mod region;
