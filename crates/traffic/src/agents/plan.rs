//! The plans of agents: their lights, local regions and sensors. Simulators and controllers follow them.
//!
//! Plans come from a road network. [`crate::paper_grid`] makes those of the paper's grids.

use std::sync::Arc;

use super::border_plan::BorderPlan;
use super::phase_plan::PhasePlan;
use super::region_plan::RegionPlan;
use super::sensor::Sensor;
use crate::config::Reward;
use crate::d_set::DSetPlan;
use dials_core::domain::Kinds;

/// The plans of all agents, and what they have in common.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct JointPlan {
    pub(crate) agents: Vec<AgentPlan>,
    /// Borders of the regions and the d-sets of the AIPs (approximate influence predictors). Empty on the paper's grids:
    /// there the approaches are the influence sources, and the observations hold the d-sets.
    pub(crate) borders: Vec<Border>,
    pub(crate) kinds: Kinds,
    /// Number of steps of SUMO, seconds, from one decision of the agents to the next.
    pub(crate) decision_steps: usize,
    pub(crate) reward: Reward,
    /// Deceleration in metres per second squared above which braking is an emergency. `None` if cars of several types
    /// drive: then only the stops are counted that SUMO calls emergencies.
    pub(crate) emergency_decel_mps2: Option<f64>,
}

/// Where traffic from outside reaches a region, and what its AIP sees.
#[derive(Clone, Debug, PartialEq)]
pub struct Border {
    pub plan: BorderPlan,
    pub d_set: DSetPlan,
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
