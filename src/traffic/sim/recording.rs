//! Recordings: what happened on the road in an episode, to the last bit.
//!
//! A [`crate::traffic::Traffic`] gets a [`Tape`]. The first episode that one of its simulators plays goes on the tape,
//! whatever controls the lights. It comes off as a [`Recording`]. [`super::replay`] turns it into files for SUMO, and
//! [`super::trace`] into data for pictures. Simulators without a tape ask SUMO for no more than they need.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result};

use crate::sumo::{CarTable, DepartSpeed, Departure, Insertion, LaneCars, LaneId, LightId, SignalState, Simulation};
use crate::traffic::cut::forest::Region;
use crate::traffic::network::contents::Network;
use crate::traffic::network::tree::Element;
use crate::traffic::paper_grid::grid::{Grid, lane};

/// A tape for one episode. Clones are the same tape.
#[derive(Clone, Debug, Default)]
pub struct Tape(Arc<Mutex<Option<Recording>>>);

impl Tape {
    /// Takes the recording off the tape; the tape is blank then.
    pub fn take(&self) -> Option<Recording> {
        self.with(Option::take)
    }

    fn with<T>(&self, work: impl FnOnce(&mut Option<Recording>) -> T) -> T {
        // After a panic elsewhere, the recording is complete up to its last step.
        work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The recording of one episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    pub roads: Arc<Roads>,
    /// Seed that SUMO got.
    pub seed: u32,
    /// Cars that entered, in the order in which they entered.
    pub entries: Vec<Entry>,
    pub steps: Vec<Step>,
}

/// A car that entered.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub step: usize,
    pub car: Departure,
    /// Speed that SUMO was told, which is not always the speed that it chose. SUMO 1.15 refuses some cars that ask for
    /// exactly the speed that it had found safe itself, because of the last bit.
    pub speed: DepartSpeed,
}

/// The roads of the recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Roads {
    pub grid: Grid,
    /// Text of the net, as SUMO loaded it.
    pub net: String,
    pub(super) vehicle_types: Vec<Element>,
    /// All lanes: those of the edges in the order of [`Grid::edges`], then those inside of intersections.
    pub lanes: Vec<Lane>,
    /// Numbers of the lanes, by name.
    numbers: HashMap<String, usize>,
    /// Names of the lights, one per agent.
    pub lights: Vec<String>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    pub name: String,
    pub length_m: f64,
}

/// One step of a second: step `t` leads from second `t` to second `t + 1`.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// State that every light showed during the step, in the order of [`Roads::lights`].
    pub signals: Vec<SignalState>,
    /// Cars after the step, lane by lane in the order of [`Roads::lanes`].
    pub cars: CarTable,
}

impl Recording {
    /// Returns the cars on a lane after each step.
    pub fn on_lane<'a>(&'a self, name: &str) -> Result<impl Iterator<Item = LaneCars<'a>> + use<'a>> {
        let lane = self.roads.number(name)?;
        Ok(self.steps.iter().map(move |step| step.cars.lane(lane)))
    }
}

impl Roads {
    /// Returns the length of a lane in metres.
    pub fn length_m(&self, name: &str) -> Result<f64> {
        Ok(self.lanes[self.number(name)?].length_m)
    }

    fn number(&self, lane: &str) -> Result<usize> {
        self.numbers.get(lane).copied().with_context(|| format!("no lane `{lane}` was recorded"))
    }

    fn of(grid: Grid, network: &Network) -> Result<Roads> {
        let place = network.files.net.display();
        let root = &network.net.root;
        let lengths: HashMap<&str, f64> = root
            .all("edge")
            .flat_map(|edge| edge.all("lane"))
            .filter_map(|lane| Some((lane.attribute("id")?, lane.attribute("length")?.parse().ok()?)))
            .collect();
        let length =
            |name: &str| lengths.get(name).copied().with_context(|| format!("{place}: no lane `{name}` with a length"));
        let edges = grid.edges().into_iter().map(|(from, to)| lane(&crate::traffic::paper_grid::grid::edge(from, to)));
        let internal = grid.agents().into_iter().flat_map(|agent| grid.internal_lanes(agent));
        let lanes = edges.chain(internal).map(|name| Ok(Lane { length_m: length(&name)?, name }));
        let lanes = lanes.collect::<Result<Vec<Lane>>>()?;
        let children = network.routes.root.children.iter();
        let vehicle_types = children.filter(|child| child.name.starts_with("vType")).cloned();
        let lights = grid.agents().into_iter().map(|agent| grid.light(agent)).collect();
        let numbers = lanes.iter().enumerate().map(|(number, lane)| (lane.name.clone(), number)).collect();
        Ok(Roads { grid, net: network.net.text(), vehicle_types: vehicle_types.collect(), lanes, numbers, lights })
    }
}

/// The tape of a simulator, with what is needed to record on it.
pub(super) struct Recorder {
    tape: Tape,
    roads: Arc<Roads>,
    /// Part of a forest that is recorded, under the names of the local net.
    region: Option<Region>,
    lanes: Vec<LaneId>,
    lights: Vec<LightId>,
    /// Whether the episode goes on the tape. The tape has room for the first one only.
    on: bool,
}

impl Recorder {
    /// Makes a recorder. `network`: that of `grid`, which is the local one for a `region` of a forest.
    pub fn new(
        tape: &Tape,
        simulation: &mut Simulation,
        grid: Grid,
        network: &Network,
        region: Option<Region>,
    ) -> Result<Recorder> {
        let roads = Roads::of(grid, network)?;
        let name = |name: &String| region.map_or_else(|| name.clone(), |region| region.rename(name));
        let lanes: Vec<String> = roads.lanes.iter().map(|lane| name(&lane.name)).collect();
        let lights: Vec<String> = roads.lights.iter().map(name).collect();
        Ok(Recorder {
            tape: tape.clone(),
            region,
            lanes: simulation.register_lanes(&lanes)?,
            lights: simulation.register_lights(&lights)?,
            on: false,
            roads: Arc::new(roads),
        })
    }

    /// Begins an episode for which SUMO got this seed.
    pub fn begin(&mut self, seed: u32) {
        self.on = self.tape.with(|tape| {
            let room = tape.as_ref().is_none_or(|recording| recording.steps.is_empty());
            if room {
                *tape = Some(Recording { roads: self.roads.clone(), seed, entries: Vec::new(), steps: Vec::new() });
            }
            room
        });
    }

    /// Records a step, before which these cars were inserted. SUMO's flows insert others.
    pub fn step(&mut self, simulation: &mut Simulation, inserted: &[Insertion]) -> Result<()> {
        if !self.on {
            return Ok(());
        }
        let mut step = Step { signals: Vec::new(), cars: CarTable::new() };
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
                let told = inserted.iter().find(|insertion| insertion.car == car.id.0).map(|insertion| insertion.speed);
                Entry { step: number, speed: told.unwrap_or(DepartSpeed::Fixed(car.speed_mps)), car }
            }));
            recording.steps.push(step);
            Ok(())
        })
    }

    /// Returns the car under the names of the recorded roads, if it is on them.
    fn renamed(&self, car: Departure) -> Option<Departure> {
        let Some(region) = self.region else { return Some(car) };
        let rename = |name: &String| region.in_the_local_net(name).map(str::to_owned);
        let edges = car.edges.iter().map(rename).collect::<Option<Vec<String>>>()?;
        Some(Departure { route: rename(&car.route)?, edges, ..car })
    }
}
