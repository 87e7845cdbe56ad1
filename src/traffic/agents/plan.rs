//! The plans of agents: their lights, local regions and sensors. Simulators and controllers follow them.
//!
//! Plans come from a road network. [`crate::traffic::paper_grid`] makes those of the paper's grids.

use std::sync::Arc;

use super::phase_plan::PhasePlan;
use super::region_plan::RegionPlan;
use super::sensor::Sensor;
use crate::domain::Kinds;

/// The plans of all agents, and what they have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPlan {
    pub agents: Vec<AgentPlan>,
    pub kinds: Kinds,
    /// Number of steps of SUMO, seconds, from one decision of the agents to the next.
    pub decision_steps: usize,
}

/// Everything that simulators need to know of one agent.
#[derive(Clone, Debug, PartialEq)]
pub struct AgentPlan {
    /// SUMO's name of the light.
    pub light: String,
    /// Place of the intersection in the net's coordinates, in metres.
    pub place_m: [f64; 2],
    pub region: RegionPlan,
    pub phases: Arc<PhasePlan>,
    pub sensor: Sensor,
}
