//! The lights of a loaded net under their plans, and what they show.

use std::sync::Arc;

use crate::agents::phase_plan::{PhasePlan, Shown};
use crate::lane_sets::SinceGreen;
use crate::light::Signal;
use dials_core::domain::{Action, Result};
use libsumo::{LightId, SignalState, Simulation};

pub(crate) struct Lights {
    lights: Vec<LightId>,
    plans: Vec<Arc<PhasePlan>>,
    signals: Vec<Signal>,
    /// For each light that one of SUMO's programs runs: its last green.
    by_program: Vec<Option<usize>>,
}

impl Lights {
    pub(crate) fn register(
        simulation: &mut Simulation,
        lights: impl Iterator<Item = (String, Arc<PhasePlan>)>,
    ) -> Result<Lights> {
        let (names, plans): (Vec<String>, Vec<Arc<PhasePlan>>) = lights.unzip();
        Ok(Lights {
            lights: simulation.register_lights(&names)?,
            signals: plans.iter().map(|plan| Signal::at_the_beginning(plan)).collect(),
            by_program: vec![None; plans.len()],
            plans,
        })
    }

    /// Returns what a light shows, if no program of SUMO runs it.
    pub(crate) fn shown(&self, row: usize) -> Shown {
        self.signals[row].shown()
    }

    /// Returns whether a light may go to a green, or keep it. One that a program of SUMO runs may do anything.
    pub(crate) fn allows(&self, row: usize, green: usize) -> bool {
        self.by_program[row].is_some() || self.signals[row].allows(&self.plans[row], green)
    }

    pub(crate) fn reset(&mut self, simulation: &mut Simulation, rows: &[usize]) -> Result<()> {
        for &row in rows {
            self.signals[row] = Signal::at_the_beginning(&self.plans[row]);
            self.by_program[row] = None;
        }
        self.show(simulation, rows)
    }

    /// Lets every agent act on its light, unless one of SUMO's programs runs it.
    pub(crate) fn act(&mut self, simulation: &mut Simulation, actions: &[Action]) -> Result<()> {
        assert_eq!(actions.len(), self.lights.len(), "one action per intersection");
        let mut changed = Vec::new();
        for (row, (signal, &action)) in self.signals.iter_mut().zip(actions).enumerate() {
            if self.by_program[row].is_some() {
                continue;
            }
            let plan = &*self.plans[row];
            let before = signal.state(plan);
            signal.act(plan, action);
            if signal.state(plan) != before {
                changed.push(row);
            }
        }
        self.show(simulation, &changed)
    }

    /// Returns the letters that SUMO says all lights show.
    pub(super) fn states(&self, simulation: &mut Simulation) -> Result<Vec<SignalState>> {
        let mut states = Vec::new();
        simulation.read_lights(&self.lights, &mut states)?;
        Ok(states)
    }

    fn read(&mut self, simulation: &mut Simulation, shown: &mut [Shown]) -> Result<()> {
        shown.iter_mut().zip(&self.signals).for_each(|(shown, signal)| *shown = signal.shown());
        let rows: Vec<usize> = (0..shown.len()).filter(|&row| self.by_program[row].is_some()).collect();
        if rows.is_empty() {
            return Ok(());
        }
        let mut states = Vec::new();
        simulation.read_lights(&self.ids(&rows), &mut states)?;
        for (row, state) in rows.into_iter().zip(&states) {
            let last = self.by_program[row].as_mut().expect("a light that a program runs");
            shown[row] = self.plans[row].recognise(state, *last);
            *last = shown[row].green().unwrap_or(*last);
        }
        Ok(())
    }

    /// Lets one of SUMO's programs run the lights of these rows. `None`: the one that SUMO has begun with.
    pub(super) fn hand_to_program(
        &mut self,
        simulation: &mut Simulation,
        program: Option<&str>,
        rows: &[usize],
    ) -> Result<()> {
        rows.iter().for_each(|&row| self.by_program[row] = Some(0));
        program.map_or(Ok(()), |program| Ok(simulation.set_programs(&self.ids(rows), program)?))
    }

    fn show(&self, simulation: &mut Simulation, rows: &[usize]) -> Result<()> {
        let states: Vec<&SignalState> = rows.iter().map(|&row| self.signals[row].state(&self.plans[row])).collect();
        Ok(simulation.set_lights(&self.ids(rows), &states)?)
    }

    fn ids(&self, rows: &[usize]) -> Vec<LightId> {
        rows.iter().map(|&row| self.lights[row]).collect()
    }
}

/// What every light of a GS shows, `[agents]`: now, a second ago, and at the last decision.
pub(super) struct ShownLights {
    pub(super) now: Vec<Shown>,
    pub(super) before: Vec<Shown>,
    pub(super) at_decision: Vec<Shown>,
    pub(super) steps: Vec<u32>,
    /// Kept only if the agents see lanes and greens as sets.
    pub(super) since: Vec<SinceGreen>,
}

impl ShownLights {
    pub(super) fn new(agents: usize) -> ShownLights {
        let [now, before, at_decision] = [(); 3].map(|()| vec![Shown::Green(0); agents]);
        ShownLights { now, before, at_decision, steps: vec![0; agents], since: Vec::new() }
    }

    pub(super) fn begin(&mut self, lights: &mut Lights, simulation: &mut Simulation) -> Result<()> {
        self.steps.fill(0);
        lights.read(simulation, &mut self.now)
    }

    pub(super) fn decide(&mut self) {
        self.at_decision.copy_from_slice(&self.now);
    }

    pub(super) fn second(&mut self, lights: &mut Lights, simulation: &mut Simulation) -> Result<()> {
        self.before.copy_from_slice(&self.now);
        lights.read(simulation, &mut self.now)?;
        for (steps, (before, now)) in self.steps.iter_mut().zip(self.before.iter().zip(&self.now)) {
            *steps = if before == now { *steps + 1 } else { 1 };
        }
        self.since.iter_mut().zip(&self.now).for_each(|(since, &shown)| since.note(shown));
        Ok(())
    }
}

/// A light shows the same for some seconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stay {
    pub(crate) shown: Shown,
    pub(crate) seconds: u32,
}

/// What every light of a GS has shown in an episode, `[agents]`.
#[derive(Default)]
pub(super) struct History(pub(super) Vec<Vec<Stay>>);

impl History {
    pub(super) fn begin(&mut self, agents: usize) {
        self.0 = vec![Vec::new(); agents];
    }

    pub(super) fn note(&mut self, shown: &[Shown]) {
        for (stays, &shown) in self.0.iter_mut().zip(shown) {
            match stays.last_mut().filter(|stay| stay.shown == shown) {
                Some(stay) => stay.seconds += 1,
                None => stays.push(Stay { shown, seconds: 1 }),
            }
        }
    }
}
