//! The plan of one agent: its light, its local region and its sensor. Simulators and controllers follow it.
//!
//! Plans come from a road network. [`crate::traffic::paper_grid`] makes those of the paper's grids.

use super::phase_plan::PhasePlan;
use super::region_plan::RegionPlan;
use super::sensor::Sensor;

/// Everything that simulators need to know of one agent.
#[derive(Clone, Debug, PartialEq)]
pub struct AgentPlan {
    /// SUMO's name of the light.
    pub light: String,
    /// Place of the intersection in the net's coordinates, in metres.
    pub place_m: [f64; 2],
    pub region: RegionPlan,
    pub phases: PhasePlan,
    pub sensor: Sensor,
}
