//! Control of the lights of a global simulator.

use crate::base::AgentId;
use crate::traffic::controllers::HandCoded;

/// The control that runs the lights.
pub enum SignalControl {
    /// The actions of each step run the lights.
    Agents,
    /// Hand-coded control runs the lights of these agents, whatever the actions say; the actions run the others.
    HandCoded { by: HandCoded, agents: Vec<AgentId> },
}

impl SignalControl {
    /// Returns the rows that one of SUMO's programs runs.
    pub fn by_program(&self) -> Vec<usize> {
        match self {
            SignalControl::HandCoded { by: HandCoded::Actuated, agents } => {
                agents.iter().map(|agent| agent.0).collect()
            }
            _ => Vec::new(),
        }
    }
}
