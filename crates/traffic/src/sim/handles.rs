//! The lights of any loaded net under their plans, and the cars on their approaches.

use std::sync::Arc;

use crate::agents::phase_plan::{PhasePlan, Shown};
use crate::cars_at::CarsAt;
use crate::light::Signal;
use dials_core::domain::{Action, Result};
use libsumo::{CarTable, LaneId, LightId, SignalState, Simulation};

/// The handles and lights of many intersections, one row each.
pub(crate) struct IntersectionHandles {
    /// Approaches of all rows, one row after the other.
    lanes: Vec<LaneId>,
    /// Number of the first approach of each row, and the number of all.
    starts: Vec<usize>,
    lights: Vec<LightId>,
    plans: Vec<Arc<PhasePlan>>,
    signals: Vec<Signal>,
    /// For each light that one of SUMO's programs runs: its last green.
    by_program: Vec<Option<usize>>,
}

/// One intersection to register: SUMO's names, and the plan of its light.
pub(crate) struct Place {
    pub(crate) light: String,
    pub(crate) approaches: Vec<String>,
    pub(crate) phases: Arc<PhasePlan>,
}

impl IntersectionHandles {
    /// Registers lanes and lights, one row per place.
    pub(crate) fn register(simulation: &mut Simulation, places: Vec<Place>) -> Result<Self> {
        let mut starts = vec![0];
        let (mut lanes, mut lights, mut plans) = (Vec::new(), Vec::new(), Vec::new());
        for Place { light, approaches, phases } in places {
            lanes.extend(approaches);
            starts.push(lanes.len());
            lights.push(light);
            plans.push(phases);
        }
        Ok(IntersectionHandles {
            lanes: simulation.register_lanes(&lanes)?,
            starts,
            lights: simulation.register_lights(&lights)?,
            signals: plans.iter().map(|plan| Signal::at_the_beginning(plan)).collect(),
            by_program: vec![None; plans.len()],
            plans,
        })
    }

    pub(crate) fn len(&self) -> usize {
        self.lights.len()
    }

    /// Returns what a light shows, if no program of SUMO runs it.
    pub(crate) fn signal(&self, row: usize) -> Signal {
        self.signals[row]
    }

    /// Sets the lights of these rows to the beginning of an episode.
    pub(crate) fn reset(&mut self, simulation: &mut Simulation, rows: &[usize]) -> Result<()> {
        for &row in rows {
            self.signals[row] = Signal::at_the_beginning(&self.plans[row]);
            self.by_program[row] = None;
        }
        self.show(simulation, rows)
    }

    /// Lets every agent act on its light, unless one of SUMO's programs runs it. Only lights that change are sent to
    /// SUMO.
    pub(crate) fn act(&mut self, simulation: &mut Simulation, actions: &[Action]) -> Result<()> {
        assert_eq!(actions.len(), self.len(), "one action per intersection");
        let mut changed = Vec::new();
        for (row, (signal, &action)) in self.signals.iter_mut().zip(actions).enumerate() {
            if self.by_program[row].is_some() {
                continue;
            }
            let (plan, before) = (&*self.plans[row], *signal);
            signal.act(plan, action);
            if signal.state(plan) != before.state(plan) {
                changed.push(row);
            }
        }
        self.show(simulation, &changed)
    }

    /// Writes what all lights show into `shown`, one per row. `states` is memory for reuse.
    pub(crate) fn read_lights(
        &mut self,
        simulation: &mut Simulation,
        states: &mut Vec<SignalState>,
        shown: &mut [Shown],
    ) -> Result<()> {
        shown.iter_mut().zip(&self.signals).for_each(|(shown, signal)| *shown = signal.shown());
        let rows: Vec<usize> = (0..self.len()).filter(|&row| self.by_program[row].is_some()).collect();
        if rows.is_empty() {
            return Ok(());
        }
        let lights: Vec<LightId> = rows.iter().map(|&row| self.lights[row]).collect();
        simulation.read_lights(&lights, states)?;
        for (row, state) in rows.into_iter().zip(states) {
            let last = self.by_program[row].as_mut().expect("a light that a program runs");
            shown[row] = self.plans[row].recognise(state, *last);
            *last = shown[row].green().unwrap_or(*last);
        }
        Ok(())
    }

    /// Lets one of SUMO's programs run the lights of these rows. `None`: the one that SUMO has begun with.
    pub(crate) fn hand_to_program(
        &mut self,
        simulation: &mut Simulation,
        program: Option<&str>,
        rows: &[usize],
    ) -> Result<()> {
        rows.iter().for_each(|&row| self.by_program[row] = Some(0));
        let lights: Vec<LightId> = rows.iter().map(|&row| self.lights[row]).collect();
        program.map_or(Ok(()), |program| Ok(simulation.set_programs(&lights, program)?))
    }

    pub(crate) fn read_cars(&self, simulation: &mut Simulation, cars: &mut CarTable) -> Result<()> {
        Ok(simulation.read_lanes(&self.lanes, cars)?)
    }

    /// Returns the cars on the approaches of a row, from a read of [`IntersectionHandles::read_cars`].
    pub(crate) fn cars_at<'a>(&self, cars: &'a CarTable, row: usize) -> CarsAt<'a> {
        CarsAt::new(cars, self.starts[row], self.starts[row + 1] - self.starts[row])
    }

    fn show(&self, simulation: &mut Simulation, rows: &[usize]) -> Result<()> {
        let lights: Vec<LightId> = rows.iter().map(|&row| self.lights[row]).collect();
        let states: Vec<&SignalState> = rows.iter().map(|&row| self.signals[row].state(&self.plans[row])).collect();
        Ok(simulation.set_lights(&lights, &states)?)
    }
}
