//! Control of the lights of a global simulator.

use crate::controllers::HandCoded;
use dials_core::base::AgentId;

/// The control that runs the lights.
pub enum SignalControl {
    /// The actions of each step run the lights.
    Agents,
    /// Hand-coded control runs the lights of these agents, whatever the actions say; the actions run the others.
    HandCoded { by: HandCoded, agents: Vec<AgentId> },
}

impl SignalControl {
    /// Returns whether SUMO's actuated programs run lights.
    pub(crate) fn is_actuated(&self) -> bool {
        matches!(self, SignalControl::HandCoded { by: HandCoded::Actuated, .. })
    }

    /// Returns the rows that programs of SUMO run.
    pub(crate) fn by_program(&self) -> Vec<usize> {
        match self {
            SignalControl::HandCoded { by: HandCoded::Actuated | HandCoded::OwnProgram, agents } => {
                agents.iter().map(|agent| agent.0).collect()
            }
            _ => Vec::new(),
        }
    }
}
