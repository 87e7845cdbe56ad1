//! Who runs the lights of a global simulator.

use crate::base::AgentId;
use crate::traffic::controllers::HandCoded;

/// Who runs the lights.
pub enum SignalControl {
    /// The actions of each step.
    Agents,
    /// Hand-coded control runs the lights of these agents, whatever the actions say; the actions run the others.
    HandCoded { by: HandCoded, agents: Vec<AgentId> },
}

impl SignalControl {
    /// The rows that a program of SUMO's runs.
    pub fn by_program(&self) -> Vec<usize> {
        match self {
            SignalControl::HandCoded { by: HandCoded::Actuated, agents } => {
                agents.iter().map(|agent| agent.0).collect()
            }
            _ => Vec::new(),
        }
    }
}
