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
    /// Returns the program of SUMO that runs lights, with their rows; `None` if none does.
    pub fn by_program(&self) -> Option<(&'static str, Vec<usize>)> {
        let SignalControl::HandCoded { by, agents } = self else { return None };
        by.program().map(|program| (program, agents.iter().map(|agent| agent.0).collect()))
    }
}
