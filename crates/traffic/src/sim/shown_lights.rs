//! What the lights of a global simulator (GS) show, and for how long.

use super::handles::IntersectionHandles;
use crate::agents::phase_plan::Shown;
use dials_core::domain::Result;
use libsumo::{SignalState, Simulation};

/// What every light shows, `[agents]`: now, a second ago, and at the last decision.
pub(super) struct ShownLights {
    pub(crate) now: Vec<Shown>,
    pub(crate) before: Vec<Shown>,
    pub(crate) at_decision: Vec<Shown>,
    /// Number of seconds for which every light has shown what it shows.
    pub(crate) steps: Vec<u32>,
    /// States that SUMO last gave, if it runs the lights.
    states: Vec<SignalState>,
}

impl ShownLights {
    pub(super) fn new(agents: usize) -> ShownLights {
        let shown = vec![Shown::Green(0); agents];
        ShownLights {
            now: shown.clone(),
            before: shown.clone(),
            at_decision: shown,
            steps: vec![0; agents],
            states: Vec::new(),
        }
    }

    /// Reads the lights at the beginning of an episode.
    pub(super) fn begin(&mut self, handles: &mut IntersectionHandles, simulation: &mut Simulation) -> Result<()> {
        self.steps.fill(0);
        handles.read_lights(simulation, &mut self.states, &mut self.now)
    }

    /// Notes that a decision is made now.
    pub(super) fn decide(&mut self) {
        self.at_decision.copy_from_slice(&self.now);
    }

    /// Reads the lights after a second.
    pub(super) fn second(&mut self, handles: &mut IntersectionHandles, simulation: &mut Simulation) -> Result<()> {
        self.before.copy_from_slice(&self.now);
        handles.read_lights(simulation, &mut self.states, &mut self.now)?;
        for (steps, (before, now)) in self.steps.iter_mut().zip(self.before.iter().zip(&self.now)) {
            *steps = if before == now { *steps + 1 } else { 1 };
        }
        Ok(())
    }
}
