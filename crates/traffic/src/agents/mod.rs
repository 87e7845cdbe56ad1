//! What an agent is. Pure: no SUMO simulation and no files.
//!
//! [`plan`] holds everything about one agent. [`mod@derive`] makes plans for the lights of any road network; [`region`]
//! and [`phases`] are of the paper's grids only.

pub(crate) mod adjacency;
pub mod border_plan;
pub mod derive;
pub(crate) mod loops;
pub mod others_plan;
pub mod phase_plan;
pub mod phases;
pub mod plan;
pub(crate) mod red_limits;
pub mod region;
pub mod region_plan;
pub(crate) mod sensor;
pub(crate) mod trapped;
