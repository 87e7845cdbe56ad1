//! The intersections of a loaded net, whichever it is: their lights, and the cars on their incoming lanes.

use crate::domain::{Action, Result};
use crate::sumo::{CarTable, LaneId, LightId, SignalState, Simulation};
use crate::traffic::agents::phases::Light;
use crate::traffic::light::Signal;

/// The handles and lights of many intersections, one row each.
pub struct IntersectionHandles {
    /// Incoming lanes, [`crate::traffic::agents::region::EDGES`] per row.
    lanes: Vec<LaneId>,
    lights: Vec<LightId>,
    signals: Vec<Signal>,
    /// Which lights a program of SUMO's runs.
    by_program: Vec<bool>,
    /// The states of [`Light::ALL`].
    states: [SignalState; 4],
}

impl IntersectionHandles {
    /// `lanes`: [`crate::traffic::agents::region::EDGES`] incoming lanes of every intersection; `lights`: one of each.
    pub fn register(simulation: &mut Simulation, lanes: &[String], lights: &[String]) -> Result<Self> {
        Ok(IntersectionHandles {
            lanes: simulation.register_lanes(lanes)?,
            signals: vec![Signal::at_the_beginning(); lights.len()],
            by_program: vec![false; lights.len()],
            lights: simulation.register_lights(lights)?,
            states: Light::ALL.map(Light::state),
        })
    }

    pub fn len(&self) -> usize {
        self.lights.len()
    }

    pub fn light(&self, row: usize) -> Light {
        self.signals[row].light()
    }

    /// Sets the lights of these rows as an episode begins.
    pub fn reset(&mut self, simulation: &mut Simulation, rows: &[usize]) -> Result<()> {
        for &row in rows {
            self.signals[row] = Signal::at_the_beginning();
            self.by_program[row] = false;
        }
        self.show(simulation, rows)
    }

    /// Lets every agent act on its light, unless a program of SUMO's runs it; SUMO hears of the lights that change.
    pub fn act(&mut self, simulation: &mut Simulation, actions: &[Action]) -> Result<()> {
        assert_eq!(actions.len(), self.len(), "one action per intersection");
        let mut changed = Vec::new();
        for (row, (signal, &action)) in self.signals.iter_mut().zip(actions).enumerate() {
            if self.by_program[row] {
                continue;
            }
            let before = signal.light();
            signal.act(action);
            if signal.light() != before {
                changed.push(row);
            }
        }
        self.show(simulation, &changed)
    }

    /// What all lights show, into `shown`, one per row. Lights that a program runs and that show anything else than the four
    /// states of a [`Light`] are an error. `states` is memory that is used again and again.
    pub fn read_lights(
        &self,
        simulation: &mut Simulation,
        states: &mut Vec<SignalState>,
        shown: &mut [Light],
    ) -> Result<()> {
        shown.iter_mut().zip(&self.signals).for_each(|(shown, signal)| *shown = signal.light());
        let rows: Vec<usize> = (0..self.len()).filter(|&row| self.by_program[row]).collect();
        if rows.is_empty() {
            return Ok(());
        }
        let lights: Vec<LightId> = rows.iter().map(|&row| self.lights[row]).collect();
        simulation.read_lights(&lights, states)?;
        for (row, state) in rows.into_iter().zip(states) {
            shown[row] = Light::of(state)
                .ok_or_else(|| anyhow::anyhow!("a light shows `{state}`, which is no state of our grids"))?;
        }
        Ok(())
    }

    /// Leaves the lights of these rows to a program of SUMO's.
    pub fn hand_to_program(&mut self, simulation: &mut Simulation, program: &str, rows: &[usize]) -> Result<()> {
        rows.iter().for_each(|&row| self.by_program[row] = true);
        let lights: Vec<LightId> = rows.iter().map(|&row| self.lights[row]).collect();
        Ok(simulation.set_programs(&lights, program)?)
    }

    pub fn read_cars(&self, simulation: &mut Simulation, cars: &mut CarTable) -> Result<()> {
        Ok(simulation.read_lanes(&self.lanes, cars)?)
    }

    fn show(&self, simulation: &mut Simulation, rows: &[usize]) -> Result<()> {
        let lights: Vec<LightId> = rows.iter().map(|&row| self.lights[row]).collect();
        let states: Vec<&SignalState> = rows.iter().map(|&row| &self.states[self.light(row) as usize]).collect();
        Ok(simulation.set_lights(&lights, &states)?)
    }
}
