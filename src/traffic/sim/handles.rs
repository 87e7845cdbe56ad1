//! The intersections of any loaded net: their lights, and the cars on their incoming lanes.

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
    /// Whether one of SUMO's programs runs the light, for each light.
    by_program: Vec<bool>,
    /// States of [`Light::ALL`].
    states: [SignalState; 4],
}

impl IntersectionHandles {
    /// Registers lanes and lights. `lanes`: [`crate::traffic::agents::region::EDGES`] incoming lanes per intersection;
    /// `lights`: one per intersection.
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

    /// Sets the lights of these rows to the beginning of an episode.
    pub fn reset(&mut self, simulation: &mut Simulation, rows: &[usize]) -> Result<()> {
        for &row in rows {
            self.signals[row] = Signal::at_the_beginning();
            self.by_program[row] = false;
        }
        self.show(simulation, rows)
    }

    /// Lets every agent act on its light, unless one of SUMO's programs runs it. Only lights that change are sent to
    /// SUMO.
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

    /// Writes what all lights show into `shown`, one per row. It is an error if a light that a program runs shows
    /// anything but the four states of a [`Light`]. `states` is memory for reuse.
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
                .ok_or_else(|| anyhow::anyhow!("a light shows `{state}`, which is not a state of our grids"))?;
        }
        Ok(())
    }

    /// Lets one of SUMO's programs run the lights of these rows.
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
