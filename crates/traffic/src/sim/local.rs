//! The LS: the surroundings of lights side by side, into which the AIPs send cars.
//!
//! On a grid of the paper all rows are alike, nothing is random, and a car that finds no room is dropped. On a scenario a
//! row is cut out of the user's net. Its cars are drawn from recorded visits and wait for room, and an episode is a window
//! of the demand, which begins at a second that is drawn.
//!
//! DEVIATION 17: the roads of a scenario are empty when the window begins, and its first seconds count. All regions of a
//! process move on together, so a reset cannot play a time before the window with some of them alone.

use std::sync::Arc;
use std::time::Instant;

use rand::Rng;

pub use super::arriving::Placement;
use super::arriving::{ArrivingCar, by_rule};
use super::entries::Entries;
use super::local_forest::LocalForest;
use super::options::LOCAL_SEED;
use super::others::Others;
use super::readings::Readings;
use super::recording::Recorder;
use super::visit_tables::VisitTables;
use super::watched::{RowShows, Watched};
use crate::agents::phase_plan::Shown;
use crate::agents::plan::{Border, JointPlan};
use crate::agents::region::EDGES;
use crate::cars_at::{CarsAt, RowLanes, no_cars};
use crate::config::EntryRule;
use crate::inflow::History;
use crate::lane_sets::{Draw, Seen, SinceGreen};
use crate::observe::{self, LightView};
use crate::reward::{self, Waiting};
use crate::scenario::travellers::Travellers;
use dials_core::base::{Dice, Phase, RandomPurpose, Rows, Stopwatch};
use dials_core::domain::roads::RoadsNow;
use dials_core::domain::{Action, Beginning, LocalSimulator, Percept, RegionSpec, Result, Transition};
use libsumo::{CarId, LaneId};

/// Name of the counter of sampled arrivals that found no room, or on a scenario no car that may use their entry.
pub(crate) const DROPPED: &str = "dropped_arrivals";

/// Seconds of an episode after which a row is as full as the GS. Only then its cars are counted, to be compared.
const SETTLED_S: usize = 120;

pub(crate) enum Demand {
    /// On a grid: all alike, placed by a rule.
    Rule(EntryRule),
    Visits(Arc<VisitTables>),
}

/// The traffic LS: one row per copy of a region. A step of it is a decision of the agents, which may take several seconds.
///
/// A row draws from random numbers of its own only. Those of SUMO are seeded lane by lane when its episode begins.
pub struct LocalTraffic {
    spec: RegionSpec,
    plan: Arc<JointPlan>,
    demand: Demand,
    forest: LocalForest,
    entries: Entries,
    rows: Vec<RowNow>,
    border_lanes: RowLanes,
    /// Lanes on which cars leave the lights; read only for a reward or agents that need them, and if the roads are watched.
    exits: RowLanes,
    /// Lanes within the junctions, for masks that mind trapped cars.
    inside: RowLanes,
    /// Influence sources of this decision as they came true, `[rows, sources]`: a car arrives when it gets in.
    came_true: Rows<u8>,
    /// Buses, if an agent needs them.
    others: Option<Others>,
    /// What is known of vehicles, if the roads are watched.
    watched: Option<Watched>,
    travellers: Option<Travellers>,
    last: Transition,
    counts: Counts,
    watch: Stopwatch,
    recorder: Option<Recorder>,
}

/// What rows of a scenario have shown at decisions since the simulators were made, once their roads were filled.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    decisions: u64,
    cars: u64,
    /// Their speeds, in whole millimetres per second of each row and decision: so the sum does not depend on the order.
    speed_mmps: u64,
}

struct RowNow {
    dice: Dice,
    /// Second of the demand, and the one at which the episode began.
    second: usize,
    begun: usize,
    shown_steps: u32,
    history: History,
    waiting: Waiting,
    /// Detectors, if the agent sees them.
    readings: Option<Readings>,
    /// Kept only if the agent sees lanes and greens as sets.
    since: Option<SinceGreen>,
}

impl RowNow {
    fn new(dice: Dice, begun: usize, border: Option<&Border>) -> RowNow {
        let history = border.map(|border| History::new(&border.plan)).unwrap_or_default();
        let (waiting, readings, since) = (Waiting::default(), None, None);
        RowNow { dice, second: begun, begun, shown_steps: 0, history, waiting, readings, since }
    }
}

impl Counts {
    fn note(&mut self, cars: CarsAt<'_>) {
        self.decisions += 1;
        self.cars += cars.cars() as u64;
        let speed_mps: f64 = cars.iter().flat_map(|lane| lane.speeds_mps).sum();
        self.speed_mmps += (1000.0 * speed_mps).round() as u64;
    }
}

impl LocalTraffic {
    /// Makes the simulators of a forest that was loaded. The first episode of the first row goes on the `recorder`.
    /// `travellers`: those of a scenario.
    pub(crate) fn new(
        plan: Arc<JointPlan>,
        demand: Demand,
        forest: LocalForest,
        recorder: Option<Recorder>,
        travellers: Option<Travellers>,
    ) -> LocalTraffic {
        let spec = plan.kinds.of(forest.rows[0].agent).spec.clone();
        let rows = forest.rows.iter().map(|row| RowNow::new(row.seed.dice(), 0, plan.borders.get(row.agent.0)));
        let agents = forest.rows.iter().map(|row| &plan.agents[row.agent.0]);
        let others = Others::of_rows(&plan, agents);
        LocalTraffic {
            others,
            watched: None,
            travellers,
            rows: rows.collect(),
            border_lanes: RowLanes::new(forest.rows.iter().map(|row| &*row.border)),
            exits: RowLanes::new(forest.rows.iter().map(|row| &*row.exits)),
            inside: RowLanes::new(forest.rows.iter().map(|row| &*row.inside)),
            came_true: Rows::new(forest.rows.len(), spec.sources.count()),
            last: Transition::new(forest.rows.len(), &spec),
            counts: Counts::default(),
            watch: Stopwatch::default(),
            recorder,
            entries: Entries::new(plan.clone(), &forest),
            spec,
            plan,
            demand,
            forest,
        }
    }

    /// Makes one step of a grid in which a car arrives at every edge that has a placement (`[rows][EDGES]`).
    /// [`LocalSimulator::step`] does so with the placements of its rule.
    pub fn step_with(&mut self, actions: &[Action], placements: &[[Option<Placement>; EDGES]]) -> Result<&Transition> {
        self.decide();
        for (row, placements) in placements.iter().enumerate() {
            for (edge, placement) in placements.iter().enumerate() {
                if let Some(placement) = placement {
                    self.entries.come(row, edge, Some(ArrivingCar::on_edge(edge, *placement)));
                }
            }
        }
        self.second(0, actions)?;
        self.perceive()?;
        Ok(&self.last)
    }

    /// Returns the cars on the approaches of a row after the last step, even if the row was reset since.
    pub fn cars_on(&self, row: usize) -> CarsAt<'_> {
        self.forest.approaches.at(row)
    }

    /// Returns the border of the region of a row. A grid has none.
    fn border(&self, row: usize) -> Option<&Border> {
        self.plan.borders.get(self.forest.rows[row].agent.0)
    }

    /// Sets what belongs to the row in this program to the beginning of an episode, and seeds its lanes.
    fn begin(&mut self, Beginning { row, episode }: Beginning) -> Result<()> {
        let seed = self.forest.rows[row].seed.for_episode(episode as usize);
        let recorder = self.recorder.as_mut().filter(|_| row == 0);
        match &self.demand {
            Demand::Rule(_) => recorder.into_iter().for_each(|recorder| recorder.begin(LOCAL_SEED, None)),
            Demand::Visits(_) => {
                let mut of_lanes = seed.fork(RandomPurpose::Lanes).dice();
                let mut seeds = self.forest.draw_seeds(row, &mut of_lanes);
                if let Some(recorder) = recorder {
                    // Plain SUMO, which plays the recording again, seeds the lanes with the numbers from its own seed on.
                    let first = of_lanes.random_range(0..1 << 30);
                    seeds = (first..).take(seeds.len()).collect();
                    recorder.begin(first, None);
                }
                self.forest.seed_lanes(row, &seeds)?;
            }
        }
        let mut dice = seed.fork(RandomPurpose::LocalCars).dice();
        let begin = dice.random_range(0..=self.spec.horizon - self.spec.local_horizon);
        self.rows[row] = RowNow::new(dice, begin * self.plan.decision_steps, self.border(row));
        if self.plan.sees_detectors() {
            let plan = &self.plan.agents[self.forest.rows[row].agent.0];
            self.rows[row].readings = Some(Readings::begin(plan.sensor.detectors(), self.plan.faults, seed));
        }
        if self.plan.sees_sets() {
            let greens = self.plan.agents[self.forest.rows[row].agent.0].greens();
            self.rows[row].since = Some(SinceGreen::begin(greens));
        }
        self.entries.begin(row, &self.forest.rows[row]);
        self.others.iter_mut().for_each(|others| others.begin_row(row));
        self.watched.iter_mut().for_each(|watched| watched.begin_row(row));
        self.came_true.row_mut(row).fill(0);
        Ok(())
    }

    fn decide(&mut self) {
        for now in &mut self.rows {
            now.waiting.decide();
            now.readings.iter_mut().for_each(Readings::decide);
        }
        self.came_true.fill(0);
    }

    fn arrive(&mut self, second: usize, sources: &Rows<u8>) {
        for (row, now) in self.rows.iter_mut().enumerate() {
            let (place, sources) = (&self.forest.rows[row], sources.row(row));
            match &self.demand {
                Demand::Rule(rule) => {
                    for edge in (0..EDGES).filter(|&edge| sources[edge] == 1) {
                        let is_new = now.second == now.begun;
                        let cars = if is_new { 0 } else { self.forest.approaches.at(row).lane(edge).len() };
                        self.entries.come(row, edge, Some(ArrivingCar::on_edge(edge, by_rule(*rule, cars))));
                    }
                }
                Demand::Visits(tables) => {
                    let (agent, border) = (place.agent.0, &self.plan.borders[place.agent.0].plan);
                    for entry in 0..border.entries.len() {
                        if sources[border.arrival(entry, second)] == 1 {
                            let what = [agent, entry, now.second];
                            let car = ArrivingCar::draw(border, &place.local_routes, tables, what, &mut now.dice);
                            self.entries.come(row, entry, car);
                        }
                    }
                }
            }
        }
    }

    fn second(&mut self, second: usize, actions: &[Action]) -> Result<()> {
        let begun = Instant::now();
        let before: Vec<Shown> = (0..self.rows.len()).map(|row| self.forest.lights.shown(row)).collect();
        self.forest.lights.act(&mut self.forest.simulation, actions)?;
        self.forest.simulation.begin_second()?;
        let tried = self.entries.let_in(&mut self.forest)?;
        if let Some(others) = &mut self.others {
            tried.buses.iter().for_each(|&(row, car)| others.bus_enters(row, car));
        }
        if let Some(watched) = &mut self.watched {
            for ((insertion, &(row, _)), (kind, route)) in tried.insertions.iter().zip(&tried.places).zip(&tried.kinds)
            {
                let place = &self.forest.rows[row];
                let edges = place.local_routes.routes.get(*route).map_or(&[][..], |route| &route.edges);
                let kind = kind.as_deref().or(self.forest.usual_type());
                watched.enters(CarId(insertion.car), [row, place.agent.0], kind, edges);
            }
        }
        self.watch.note(Phase::Insertion, begun.elapsed());
        self.watch.time(Phase::SimulatorStep, || self.forest.simulation.step())?;
        let begun = Instant::now();
        for (row, entry) in self.entries.note_entered(&mut self.forest, &tried)? {
            let source = self.border(row).map_or(entry, |border| border.plan.arrival(entry, second));
            self.came_true.row_mut(row)[source] = 1;
        }
        self.watch.note(Phase::Insertion, begun.elapsed());
        let begun = Instant::now();
        for (row, (now, before)) in self.rows.iter_mut().zip(before).enumerate() {
            now.second += 1;
            let same = before == self.forest.lights.shown(row);
            now.shown_steps = if same { now.shown_steps + 1 } else { 1 };
            now.since.iter_mut().for_each(|since| since.note(self.forest.lights.shown(row)));
        }
        let is_last = second + 1 == self.plan.decision_steps;
        let needs_waiting = self.watched.is_some() || reward::needs_waiting(&self.plan.reward);
        let sees_detectors = self.plan.sees_detectors();
        if is_last || needs_waiting || sees_detectors {
            self.forest.approaches.read(&mut self.forest.simulation)?;
        }
        if needs_waiting {
            for (row, now) in self.rows.iter_mut().enumerate() {
                now.waiting.note(self.forest.approaches.at(row));
            }
        }
        if reward::needs_co2(&self.plan.reward) {
            let of_rows = self.forest.approaches.co2_mg_per_s(&mut self.forest.simulation)?;
            self.rows.iter_mut().zip(of_rows).for_each(|(now, mg)| now.waiting.note_co2(mg));
        }
        if sees_detectors {
            for (row, now) in self.rows.iter_mut().enumerate() {
                let region = &self.plan.agents[self.forest.rows[row].agent.0].region;
                let cars = self.forest.approaches.at(row);
                now.readings.iter_mut().for_each(|readings| readings.second(region, cars));
            }
        }
        self.watch.note(Phase::Reading, begun.elapsed());
        self.recorder.as_mut().map_or(Ok(()), |recorder| recorder.step(&mut self.forest.simulation, &tried.insertions))
    }

    /// Writes what a row shows: cars on its approaches, on its exits, within its junctions, and on the lanes of its border.
    fn show(&mut self, row: usize, [cars, exits, inside, at_border]: [CarsAt<'_>; 4]) {
        let (now, agent) = (&self.rows[row], self.forest.rows[row].agent.0);
        let plan = &self.plan.agents[agent];
        let lights = &self.forest.lights;
        let clock = now.second + plan.sensor.clock_ahead;
        let light = LightView { shown: lights.shown(row), shown_steps: now.shown_steps, age: now.second, clock };
        let Percept { obs, d_set, masks } = &mut self.last.percept;
        let (obs, d_set) = (obs.row_mut(row), d_set.row_mut(row));
        observe::observe(plan, cars, light, obs);
        if let Some(since) = &now.since {
            // All cars are seen here, and nobody walks.
            let (shown, shown_steps, draw) = (light.shown, light.shown_steps, Draw::default());
            let seen = Seen { cars, exits, people: &[], shown, shown_steps, since, draw, readings: None };
            observe::observe_sets(plan, &seen, obs);
        }
        if let Some(readings) = &now.readings {
            observe::observe_detectors(plan, readings, obs);
        }
        if let Some(others) = &self.others {
            // Nobody walks here.
            observe::observe_others(plan, &others.now[row], &[], obs);
        }
        match self.plan.borders.get(agent) {
            Some(border) => border.d_set.write(&border.plan, at_border, light, &now.history, d_set),
            None => observe::d_separate(plan, cars, obs, self.came_true.row(row), d_set),
        }
        if let Some(masks) = masks {
            let allows = |green| lights.allows(row, green);
            observe::mask(plan, light.shown, inside, allows, masks.row_mut(row));
        }
    }

    /// Reads everything after a decision, and writes percepts and rewards of all rows.
    fn perceive(&mut self) -> Result<()> {
        let begun = Instant::now();
        self.border_lanes.read(&mut self.forest.simulation)?;
        if self.watched.is_some() || self.plan.sees_sets() || reward::needs_exits(&self.plan.reward) {
            self.exits.read(&mut self.forest.simulation)?;
        }
        if !self.inside.is_empty() {
            self.inside.read(&mut self.forest.simulation)?;
        }
        if let Some(others) = &mut self.others {
            let plans = self.forest.rows.iter().map(|row| &self.plan.agents[row.agent.0]);
            others.read(&mut self.forest.simulation, plans, |row| self.forest.approaches.at(row))?;
        }
        let lanes = [&mut self.forest.approaches, &mut self.exits, &mut self.inside, &mut self.border_lanes];
        let [approaches, exits, inside, border_lanes] = lanes.map(std::mem::take);
        for row in 0..self.rows.len() {
            let agent = self.forest.rows[row].agent.0;
            let (cars, now) = (approaches.at(row), &mut self.rows[row]);
            let region = &self.plan.agents[agent].region;
            let others = self.others.as_ref().map(|others| &others.now[row]);
            self.last.rewards[row] =
                reward::reward(&self.plan.reward, region, cars, exits.at(row), &now.waiting, others, &[]);
            if let Some(border) = self.plan.borders.get(agent) {
                now.history.note(&border.plan, self.came_true.row(row));
                if now.second - now.begun > SETTLED_S {
                    self.counts.note(cars);
                }
            }
            self.show(row, [cars, exits.at(row), inside.at(row), border_lanes.at(row)]);
        }
        (self.forest.approaches, self.exits) = (approaches, exits);
        (self.inside, self.border_lanes) = (inside, border_lanes);
        self.watch.note(Phase::Reading, begun.elapsed());
        Ok(())
    }
}

impl LocalSimulator for LocalTraffic {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.rows.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        let rows: Vec<usize> = begin.iter().map(|beginning| beginning.row).collect();
        let lanes: Vec<LaneId> = rows.iter().flat_map(|&row| &self.forest.rows[row].lanes).copied().collect();
        self.forest.simulation.remove_cars(&lanes)?;
        self.forest.lights.reset(&mut self.forest.simulation, &rows)?;
        begin.iter().try_for_each(|&beginning| self.begin(beginning))?;
        self.entries.set_gates(&mut self.forest, rows.iter().copied(), 0, None)?;
        for row in rows {
            let place = &self.forest.rows[row];
            let approaches = self.plan.agents[place.agent.0].region.approaches.len();
            let nobody = [approaches, place.exits.len(), place.inside.len(), place.border.len()].map(no_cars);
            self.show(row, nobody.each_ref().map(CarsAt::all));
        }
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        self.decide();
        for row in 0..self.rows.len() {
            if let Some(blocked) = self.border(row).map(|border| border.plan.all_blocked()) {
                self.came_true.row_mut(row)[blocked.clone()].copy_from_slice(&sources.row(row)[blocked]);
            }
        }
        for second in 0..self.plan.decision_steps {
            let begun = Instant::now();
            self.entries.set_gates(&mut self.forest, 0..self.rows.len(), second, Some(sources))?;
            self.arrive(second, sources);
            self.watch.note(Phase::Insertion, begun.elapsed());
            self.second(second, actions)?;
        }
        self.perceive()?;
        Ok(&self.last)
    }

    fn watch_roads(&mut self) -> Result<bool> {
        self.watched = Some(Watched::new(&self.plan, self.travellers.as_ref()));
        Ok(true)
    }

    fn roads(&self, now: &mut RoadsNow) {
        now.clear();
        let Some(watched) = &self.watched else { return };
        for (row, of_row) in self.rows.iter().enumerate() {
            let shows = RowShows {
                shown: self.forest.lights.shown(row),
                shown_s: of_row.shown_steps,
                waiting: &of_row.waiting,
                readings: of_row.readings.as_ref(),
                persons: 0,
            };
            let lanes = [&self.forest.approaches, &self.exits].map(|lanes| lanes.at(row));
            if of_row.second == of_row.begun {
                // The cars of an episode that is over were not read again.
                let none = lanes.map(|lanes| no_cars(lanes.iter().len()));
                watched.put_row(row, &shows, none.each_ref().map(CarsAt::all), now);
            } else {
                watched.put_row(row, &shows, lanes, now);
            }
        }
    }

    fn counters(&self) -> Vec<(String, u64)> {
        let (entries, Counts { decisions, cars, speed_mmps }) = (self.entries.counts, self.counts);
        let counters = match self.demand {
            Demand::Rule(_) => vec![("sampled_arrivals", entries.came), (DROPPED, entries.dropped)],
            Demand::Visits(_) => vec![
                ("sampled_arrivals", entries.came),
                ("waited_arrivals", entries.waited),
                (DROPPED, entries.dropped),
                ("local_decisions", decisions),
                ("local_cars", cars),
                ("local_speed_mmps", speed_mmps),
            ],
        };
        counters.into_iter().map(|(name, count)| (name.to_owned(), count)).collect()
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.watch.take()
    }
}
