//! What an agent is. Pure: no SUMO simulation and no files.
//!
//! - [`plan`]: everything about one agent; [`region_plan`]: the lanes around its light; [`phase_plan`]: what its light
//!   can show; [`sensor`]: the columns of its observation.
//! - [`border_plan`]: where cars come into a region of a scenario and leave it.
//! - [`mod@derive`]: all of this for the lights of any road network.
//! - [`region`]: the shape of a local region of the paper's grids.
//! - [`phases`]: the phases that the light of an intersection of theirs can show.

pub mod border_plan;
pub mod derive;
pub mod phase_plan;
pub mod phases;
pub mod plan;
pub mod region;
pub mod region_plan;
pub(crate) mod sensor;
