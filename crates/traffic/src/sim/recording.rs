//! Recordings: what happened on the road in an episode, to the last bit.
//!
//! The first episode that a simulator of a [`crate::Traffic`] with a [`Tape`] plays goes on the tape. It comes off as a
//! [`Recording`]. [`super::replay`] turns it into files for SUMO, and [`super::trace`] into data for pictures.

use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result};

use super::recorded_roads::RecordedRoads;
use crate::cut::names::prefixed;
use crate::scenario::SumoScenario;
use libsumo::{CarId, CarTable, DepartSpeed, Departure, Insertion, LaneCars, LaneId, LightId, SignalState, Simulation};

/// A tape for one episode. Clones are the same tape.
#[derive(Clone, Debug, Default)]
pub struct Tape(Arc<Mutex<Option<Recording>>>);

impl Tape {
    /// Takes the recording off the tape; the tape is blank then.
    pub fn take(&self) -> Option<Recording> {
        self.with(Option::take)
    }

    pub fn put_back(&self, recording: Recording) {
        self.with(|tape| *tape = Some(recording));
    }

    fn with<T>(&self, work: impl FnOnce(&mut Option<Recording>) -> T) -> T {
        // After a panic elsewhere, the recording is complete up to its last step.
        work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[derive(Clone, Debug)]
pub struct Recording {
    pub roads: Arc<RecordedRoads>,
    pub seed: u32,
    /// Cars that entered, in the order in which they entered.
    pub entries: Vec<Entry>,
    pub steps: Vec<Step>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub step: usize,
    pub car: Departure,
    /// Speed that SUMO was asked for, which is not always the one that it chose. SUMO 1.15 refuses some cars that ask for
    /// exactly the speed that it had found safe itself, because of the last bit.
    pub(crate) speed: DepartSpeed,
}

/// One step of a second: step `t` leads from second `t` to second `t + 1`.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// State that every light showed during the step, in the order of [`RecordedRoads::lights`].
    pub signals: Vec<SignalState>,
    /// Cars after the step, lane by lane in the order of [`RecordedRoads::lanes`].
    pub cars: CarTable,
    /// Cars that ended their trip or began to teleport in the step.
    pub(crate) gone: Vec<CarId>,
}

impl Recording {
    pub(crate) fn on_lane<'a>(&'a self, name: &str) -> Result<impl Iterator<Item = LaneCars<'a>> + use<'a>> {
        let lane = self.roads.number(name)?;
        Ok(self.steps.iter().map(move |step| step.cars.lane(lane)))
    }
}

/// The tape of a simulator, with what is needed to record on it.
pub(crate) struct Recorder {
    tape: Tape,
    roads: Arc<RecordedRoads>,
    /// Prefix of the names in the simulation: a part of a forest is recorded under the names of its local net.
    prefix: String,
    lanes: Vec<LaneId>,
    lights: Vec<LightId>,
    /// Whether the episode goes on the tape. The tape has room for the first one only.
    on: bool,
}

impl Recorder {
    /// `roads`: those of the simulation. If they are a part of it, `prefix` stands before their names there.
    pub(crate) fn new(
        tape: &Tape,
        simulation: &mut Simulation,
        roads: RecordedRoads,
        prefix: String,
    ) -> Result<Recorder> {
        let name = |name: &String| prefixed(&prefix, name);
        let lanes: Vec<String> = roads.lanes.iter().map(name).collect();
        let lights: Vec<String> = roads.lights.iter().map(name).collect();
        Ok(Recorder {
            tape: tape.clone(),
            lanes: simulation.register_lanes(&lanes)?,
            lights: simulation.register_lights(&lights)?,
            on: false,
            prefix,
            roads: Arc::new(roads),
        })
    }

    /// Begins an episode for which SUMO got this seed. `played`: what it plays, if episodes play different route files.
    pub(super) fn begin(&mut self, seed: u32, played: Option<&SumoScenario>) {
        let roads = || match played {
            Some(scenario) => Arc::new(self.roads.playing(scenario)),
            None => self.roads.clone(),
        };
        self.on = self.tape.with(|tape| {
            let room = tape.as_ref().is_none_or(|recording| recording.steps.is_empty());
            if room {
                *tape = Some(Recording { roads: roads(), seed, entries: Vec::new(), steps: Vec::new() });
            }
            room
        });
    }

    /// Records a step, before which these cars were inserted. SUMO's flows insert others.
    pub(super) fn step(&mut self, simulation: &mut Simulation, inserted: &[Insertion]) -> Result<()> {
        if !self.on {
            return Ok(());
        }
        let mut step = Step { signals: Vec::new(), cars: CarTable::new(), gone: simulation.gone()? };
        // SUMO moves its own programs on at the beginning of a step, so a light has shown its state during the whole
        // step.
        simulation.read_lights(&self.lights, &mut step.signals)?;
        simulation.read_lanes(&self.lanes, &mut step.cars)?;
        let cars: Vec<Departure> = simulation.departures()?.into_iter().filter_map(|car| self.renamed(car)).collect();
        self.tape.with(|tape| {
            let recording =
                tape.as_mut().context("the recording was taken off the tape in the middle of an episode")?;
            let number = recording.steps.len();
            recording.entries.extend(cars.into_iter().map(|car| {
                let asked =
                    inserted.iter().find(|insertion| insertion.car == car.id.0).map(|insertion| insertion.speed);
                Entry { step: number, speed: asked.unwrap_or(DepartSpeed::Fixed(car.speed_mps)), car }
            }));
            recording.steps.push(step);
            Ok(())
        })
    }

    /// Returns the car under the names of the recorded roads, if it is on them.
    fn renamed(&self, car: Departure) -> Option<Departure> {
        let rename = |name: &String| name.strip_prefix(&self.prefix).map(str::to_owned);
        let edges = car.edges.iter().map(rename).collect::<Option<Vec<String>>>()?;
        Some(Departure { route: rename(&car.route)?, edges, ..car })
    }
}
