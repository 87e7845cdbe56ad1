//! The local simulators (LS): a forest of single intersections into which the AIPs (approximate influence predictors)
//! send cars.

use std::time::Instant;

use anyhow::{Context, ensure};

use super::handles::{IntersectionHandles, Place};
use super::options;
use super::recorded_roads::RecordedRoads;
use super::recording::{Recorder, Tape};
use crate::agents::plan::AgentPlan;
use crate::agents::region::{self, EDGES};
use crate::arrivals::is_rearmost;
use crate::cars_at::CarsAt;
use crate::config::{EntryRule, Reward, TrafficConfig};
use crate::cut::forest::{Forest, Region};
use crate::network::contents::Network;
use crate::network::loadable::explain;
use crate::network::memory_file::MemoryFile;
use crate::observe::{self, LightView};
use crate::paper_grid::grid::Grid;
use crate::paper_grid::plans::plans;
use crate::reward::{self, Waiting};
use dials_core::base::{Phase, Rows, Stopwatch};
use dials_core::domain::{Action, Beginning, LocalSimulator, Percept, RegionSpec, Result, Transition};
use libsumo::{CarId, CarTable, DepartSpeed, Insertion, LaneId, RouteId, Simulation};

/// Name of the counter of sampled arrivals that found no room.
pub(crate) const DROPPED: &str = "dropped_arrivals";

/// SUMO's seed. It changes nothing, because there are no speed factors to draw and no flows.
const SEED: u32 = 0;

/// The position and speed with which an arriving car is put on its edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    pub position_m: f64,
    pub speed: DepartSpeed,
}

/// The traffic LS of many regions: one intersection of a forest per row.
///
/// Nothing in it is random: actions and sources determine everything.
pub struct LocalTraffic {
    spec: RegionSpec,
    /// Plan of the one agent of the local net.
    plan: AgentPlan,
    entry_rule: EntryRule,
    reward: Reward,
    simulation: Simulation,
    handles: IntersectionHandles,
    /// Incoming, internal and outgoing lanes per row: all lanes that a reset has to clear.
    all_lanes: Vec<Vec<LaneId>>,
    /// Routes, [`EDGES`] per row.
    routes: Vec<RouteId>,
    cars: CarTable,
    /// Outgoing lanes, [`EDGES`] per row, and the cars on them; read only for a reward that needs them.
    exit_lanes: Vec<LaneId>,
    exits: CarTable,
    /// Time that cars have waited, per row; noted only for a reward that needs it.
    waiting: Vec<Waiting>,
    /// Number of cars on each incoming edge at the last decision.
    cars_on: Rows<usize>,
    arrivals: Rows<u8>,
    /// Number of steps since the episode of each row began, and by how many the clock of each row is ahead of it.
    ages: Vec<usize>,
    clocks_ahead: Vec<usize>,
    last: Transition,
    serial: u64,
    sampled: u64,
    dropped: u64,
    watch: Stopwatch,
    recorder: Option<Recorder>,
}

impl LocalTraffic {
    /// Loads a forest of `rows` copies of the `local` net. The first episode of the first row goes on the `tape`.
    pub(crate) fn load(
        local: &Network,
        rows: usize,
        config: &TrafficConfig,
        tape: Option<&Tape>,
    ) -> Result<LocalTraffic> {
        let spec = region::spec(config);
        ensure!(rows >= 1, "a forest of 0 regions: needs at least one");
        let forest = Forest::of(local, rows);
        let (net, routes) = (MemoryFile::new(&forest.net)?, MemoryFile::new(&forest.routes)?);
        // SUMO reads both completely and never loads them again, so their memory is given back at once.
        let made_of = [(&net, &*local.files.net), (&routes, &*local.files.routes)];
        let mut simulation = Simulation::load(&options(&net, &routes))
            .map_err(|error| explain(&error, made_of))
            .with_context(|| format!("{}: {rows} copies of this network side by side", local.files.net.display()))?;
        drop((net, routes, forest));
        let regions: Vec<Region> = (0..rows).map(Region).collect();
        let plan = plans(Grid::SINGLE, config).remove(0);
        let place = |region: &Region| Place {
            light: region.light(),
            approaches: region.incoming_lanes().to_vec(),
            phases: plan.phases.clone(),
        };
        let places = regions.iter().map(place).collect();
        let routes: Vec<String> = regions.iter().flat_map(|region| region.routes()).collect();
        let handles = IntersectionHandles::register(&mut simulation, places)?;
        let routes = simulation.register_routes(&routes)?;
        let mut all_lanes = Vec::with_capacity(rows);
        let mut exit_lanes = Vec::with_capacity(rows * EDGES);
        for region in regions {
            exit_lanes.extend(simulation.register_lanes(&region.outgoing_lanes())?);
            let lanes = [region.incoming_lanes(), region.internal_lanes(), region.outgoing_lanes()].concat();
            all_lanes.push(simulation.register_lanes(&lanes)?);
        }
        let record = |tape| {
            let roads = RecordedRoads::of_grid(Grid::SINGLE, local, vec![plan.clone()])?;
            Recorder::new(tape, &mut simulation, roads, Region(0).prefix())
        };
        let recorder = tape.map(record).transpose()?;
        Ok(LocalTraffic {
            entry_rule: config.entry,
            reward: config.reward.clone(),
            simulation,
            handles,
            all_lanes,
            routes,
            cars: CarTable::new(),
            exits: CarTable::of(vec![Vec::new(); exit_lanes.len()]),
            exit_lanes,
            waiting: vec![Waiting::default(); rows],
            cars_on: Rows::new(rows, EDGES),
            arrivals: Rows::new(rows, EDGES),
            ages: vec![0; rows],
            clocks_ahead: vec![0; rows],
            last: Transition::new(rows, &spec),
            serial: 0,
            sampled: 0,
            dropped: 0,
            watch: Stopwatch::default(),
            recorder,
            plan,
            spec,
        })
    }

    /// Lets the clock of each row be ahead of its episode by a number of steps.
    pub(crate) fn with_clocks_ahead(self, clocks_ahead: Vec<usize>) -> LocalTraffic {
        assert_eq!(clocks_ahead.len(), self.rows(), "one clock per row");
        LocalTraffic { clocks_ahead, ..self }
    }

    /// Makes one step in which a car arrives at every edge that has a placement (`[rows][EDGES]`). A car that does not
    /// fit in is dropped. [`LocalSimulator::step`] calls it with the placements of its rule.
    pub fn step_with(&mut self, actions: &[Action], placements: &[[Option<Placement>; EDGES]]) -> Result<&Transition> {
        let begun = Instant::now();
        self.waiting.iter_mut().for_each(Waiting::decide);
        self.handles.act(&mut self.simulation, actions)?;
        let first_serial = self.serial;
        let sampled: Vec<(usize, Placement)> = placements
            .as_flattened()
            .iter()
            .enumerate()
            .filter_map(|(edge, placement)| placement.map(|placement| (edge, placement)))
            .collect();
        let insertions: Vec<Insertion> = sampled
            .iter()
            .zip(first_serial..)
            .map(|(&(edge, Placement { position_m, speed }), car)| Insertion {
                car,
                route: self.routes[edge],
                position_m,
                speed,
            })
            .collect();
        self.serial += insertions.len() as u64;
        self.simulation.insert(&insertions)?;
        self.watch.note(Phase::Insertion, begun.elapsed());
        self.watch.time(Phase::SimulatorStep, || self.simulation.step())?;
        self.watch.time(Phase::Insertion, || self.simulation.clear_pending())?;
        let begun = Instant::now();
        self.handles.read_cars(&mut self.simulation, &mut self.cars)?;
        if reward::needs_exits(&self.reward) {
            self.simulation.read_lanes(&self.exit_lanes, &mut self.exits)?;
        }
        let needs_waiting = reward::needs_waiting(&self.reward);
        self.arrivals.fill(0);
        for (&(edge, _), car) in sampled.iter().zip(first_serial..) {
            let arrived = is_rearmost(CarId(car), self.cars.lane(edge));
            self.arrivals.as_mut_slice()[edge] = u8::from(arrived);
            self.dropped += u64::from(!arrived);
        }
        self.sampled += sampled.len() as u64;
        let Transition { percept, rewards } = &mut self.last;
        for (row, reward) in rewards.iter_mut().enumerate() {
            let (plan, cars) = (&self.plan, self.handles.cars_at(&self.cars, row));
            self.ages[row] += 1;
            let (shown, age) = (self.handles.signal(row).shown(), self.ages[row]);
            let light = LightView { shown, shown_steps: 0, age, clock: age + self.clocks_ahead[row] };
            observe::observe(plan, cars, light, percept.obs.row_mut(row));
            observe::d_separate(plan, cars, percept.obs.row(row), self.arrivals.row(row), percept.d_set.row_mut(row));
            if needs_waiting {
                self.waiting[row].note(cars);
            }
            let exits = CarsAt::new(&self.exits, row * EDGES, EDGES);
            *reward = reward::reward(&self.reward, &plan.region, cars, exits, &self.waiting[row]);
            self.cars_on.row_mut(row).iter_mut().zip(cars.iter()).for_each(|(count, edge)| *count = edge.len());
        }
        self.watch.note(Phase::Reading, begun.elapsed());
        if let Some(recorder) = &mut self.recorder {
            recorder.step(&mut self.simulation, &insertions)?;
        }
        Ok(&self.last)
    }

    /// Returns the cars on the incoming edges of a row after the last step, even if the row was reset since.
    pub fn cars_on(&self, row: usize) -> CarsAt<'_> {
        self.handles.cars_at(&self.cars, row)
    }

    fn placement(&self, cars_on_edge: usize) -> Placement {
        match self.entry_rule {
            // The authors' rule.
            EntryRule::Reference => {
                let speed = if cars_on_edge > 8 { 3.0 } else { 9.5 };
                Placement { position_m: 6.0, speed: DepartSpeed::Fixed(speed) }
            }
            // DEVIATION 10: the car enters as far back and as fast as it can. The authors' rule drops one car in nine,
            // because a fixed speed is often unsafe behind a car that has just entered.
            EntryRule::Max => Placement { position_m: 5.0, speed: DepartSpeed::Max },
        }
    }
}

impl LocalSimulator for LocalTraffic {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.handles.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        let rows: Vec<usize> = begin.iter().map(|beginning| beginning.row).collect();
        let lanes: Vec<LaneId> = rows.iter().flat_map(|&row| &self.all_lanes[row]).copied().collect();
        self.simulation.remove_cars(&lanes)?;
        self.handles.reset(&mut self.simulation, &rows)?;
        if let Some(recorder) = &mut self.recorder
            && rows.contains(&0)
        {
            recorder.begin(SEED);
        }
        let empty = CarTable::of(vec![Vec::new(); EDGES]);
        let nobody = CarsAt::new(&empty, 0, EDGES);
        for row in rows {
            self.cars_on.row_mut(row).fill(0);
            self.arrivals.row_mut(row).fill(0);
            self.ages[row] = 0;
            self.waiting[row] = Waiting::default();
            let percept = &mut self.last.percept;
            let (plan, shown) = (&self.plan, self.handles.signal(row).shown());
            let light = LightView { shown, shown_steps: 0, age: 0, clock: self.clocks_ahead[row] };
            observe::observe(plan, nobody, light, percept.obs.row_mut(row));
            observe::d_separate(plan, nobody, percept.obs.row(row), self.arrivals.row(row), percept.d_set.row_mut(row));
        }
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        let begun = Instant::now();
        let placements: Vec<[Option<Placement>; EDGES]> = sources
            .iter()
            .zip(self.cars_on.iter())
            .map(|(sources, cars_on)| {
                std::array::from_fn(|edge| (sources[edge] == 1).then(|| self.placement(cars_on[edge])))
            })
            .collect();
        self.watch.note(Phase::Insertion, begun.elapsed());
        self.step_with(actions, &placements)
    }

    fn counters(&self) -> Vec<(&'static str, u64)> {
        vec![("sampled_arrivals", self.sampled), (DROPPED, self.dropped)]
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.watch.take()
    }
}

fn options(net: &MemoryFile, routes: &MemoryFile) -> Vec<String> {
    let mut options = options::common(net, routes, SEED);
    // On one lane without overtaking there are no collisions, and looking for them takes 3 % of a step. A test checks
    // that this option changes nothing, however dense the traffic.
    options.extend(["--collision.action".to_owned(), "none".to_owned()]);
    options
}
