//! The local simulators (LS) of a scenario: the surroundings of each light, cut out of its net, into which the AIPs
//! (approximate influence predictors) send cars.
//!
//! An episode is a window of the demand. It begins at a second that is drawn, and with empty roads.
//!
//! DEVIATION 17: the roads are empty when the window begins, and its first seconds count. All regions of a process move
//! on together, so a reset cannot play a time before the window with some of them alone.

use std::sync::Arc;
use std::time::Instant;

use rand::Rng;

use super::doors::Doors;
use super::entrance::draw;
use super::global::starts;
use super::local::DROPPED;
use super::local_forest::{LocalForest, LocalParts, RowPlace};
use super::recorded_local::roads_of;
use super::recording::{Recorder, Tape};
use super::visit_tables::VisitTables;
use crate::agents::phase_plan::Shown;
use crate::agents::plan::JointPlan;
use crate::cars_at::CarsAt;
use crate::cut::mixed::prefix;
use crate::inflow::History;
use crate::observe::{self, LightView};
use crate::reward::{self, Waiting};
use dials_core::base::{AgentId, Dice, Phase, RandomPurpose, Rows, Seed, Stopwatch};
use dials_core::domain::{Action, Beginning, LocalSimulator, Percept, RegionSpec, Result, Transition};
use libsumo::{CarTable, LaneId};

/// Seconds of an episode after which the roads of a row are as full as those of the GS (global simulator). Only then its
/// cars are counted, to be compared.
const SETTLED_S: usize = 120;

/// The traffic LS of a scenario: one row per copy of a region.
///
/// A row draws from random numbers of its own only. Those of SUMO are seeded lane by lane when its episode begins.
pub(crate) struct LocalScenario {
    spec: RegionSpec,
    plan: Arc<JointPlan>,
    tables: Arc<VisitTables>,
    forest: LocalForest,
    doors: Doors,
    rows: Vec<RowNow>,
    /// Lanes of the borders of all rows, the first one of each row, and the cars on them.
    border_lanes: Vec<LaneId>,
    first_border: Vec<usize>,
    border_cars: CarTable,
    /// Lanes on which cars leave the lights, in the same way; read only for a reward that needs them.
    exit_lanes: Vec<LaneId>,
    first_exit: Vec<usize>,
    exit_cars: CarTable,
    /// Cars on the approaches.
    cars: CarTable,
    /// Influence sources of this decision as they came true, `[rows, sources]`: a car for which there is no room arrives
    /// when it gets in, as on the GS.
    came_true: Rows<u8>,
    last: Transition,
    counts: Counts,
    /// Number of arrivals at entries that no known car may use.
    dropped: u64,
    watch: Stopwatch,
    recorder: Option<Recorder>,
}

/// What rows have shown at decisions since the simulators were made, once their roads were filled.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    decisions: u64,
    /// Cars on the approaches.
    cars: u64,
    /// Their speeds, in whole millimetres per second of each row and decision: so the sum does not depend on the order.
    speed_mmps: u64,
}

/// The episode of a row.
struct RowNow {
    dice: Dice,
    /// Second of the demand, and the one at which the episode began.
    second: usize,
    begun: usize,
    /// Number of seconds for which the light has shown what it shows.
    shown_steps: u32,
    history: History,
    waiting: Waiting,
}

impl Counts {
    fn note(&mut self, cars: CarsAt<'_>) {
        self.decisions += 1;
        self.cars += cars.cars() as u64;
        let speed_mps: f64 = cars.iter().flat_map(|lane| lane.speeds_mps).sum();
        self.speed_mmps += (1000.0 * speed_mps).round() as u64;
    }
}

impl LocalScenario {
    /// Loads `copies` of each of these regions. `tables`: from which cars are drawn.
    pub(crate) fn load(
        parts: &LocalParts,
        plan: &Arc<JointPlan>,
        tables: Arc<VisitTables>,
        regions: &[AgentId],
        copies: usize,
        seed: Seed,
    ) -> Result<LocalScenario> {
        anyhow::ensure!(!regions.is_empty() && copies > 0, "a forest of 0 regions: needs at least one");
        let forest = LocalForest::load(parts, plan, &tables, (regions, copies), seed)?;
        let spec = plan.kinds.of(regions[0]).spec.clone();
        let lanes_of = |lanes: fn(&RowPlace) -> &Vec<LaneId>| {
            let first = starts(forest.rows.iter().map(|row| lanes(row).len()));
            (forest.rows.iter().flat_map(lanes).copied().collect::<Vec<_>>(), first)
        };
        let (border_lanes, first_border) = lanes_of(|row| &row.border);
        let (exit_lanes, first_exit) = lanes_of(|row| &row.exits);
        let row = |place: &RowPlace| {
            let border = &plan.borders[place.agent.0].plan;
            RowNow {
                dice: seed.dice(),
                second: 0,
                begun: 0,
                shown_steps: 0,
                history: History::new(border),
                waiting: Waiting::default(),
            }
        };
        Ok(LocalScenario {
            rows: forest.rows.iter().map(row).collect(),
            border_cars: nobody(border_lanes.len()),
            exit_cars: nobody(exit_lanes.len()),
            cars: CarTable::new(),
            came_true: Rows::new(forest.rows.len(), spec.sources.count()),
            last: Transition::new(forest.rows.len(), &spec),
            border_lanes,
            first_border,
            exit_lanes,
            first_exit,
            counts: Counts::default(),
            dropped: 0,
            watch: Stopwatch::default(),
            recorder: None,
            spec,
            doors: Doors::new(plan.clone(), &forest),
            plan: plan.clone(),
            tables,
            forest,
        })
    }

    /// Makes the first episode of the first row go on this tape. `parts`: what it was loaded from.
    pub(crate) fn record_on(mut self, tape: &Tape, parts: &LocalParts) -> Result<LocalScenario> {
        let roads = roads_of(parts, &self.plan, &self.forest.rows[0], self.forest.first.clone())?;
        self.recorder = Some(Recorder::new(tape, &mut self.forest.simulation, roads, prefix(0))?);
        Ok(self)
    }

    /// Sets what belongs to the row in this program to the beginning of an episode, and seeds its lanes.
    fn begin(&mut self, Beginning { row, episode }: Beginning) -> Result<()> {
        let place = &self.forest.rows[row];
        let border = &self.plan.borders[place.agent.0].plan;
        let seed = place.seed.for_episode(episode as usize);
        let mut of_lanes = seed.fork(RandomPurpose::Lanes).dice();
        let mut seeds = self.forest.draw_seeds(row, &mut of_lanes);
        if let Some(recorder) = self.recorder.as_mut().filter(|_| row == 0) {
            // Plain SUMO, which plays the recording again, seeds the lanes with the numbers from its own seed on.
            let first = of_lanes.random_range(0..1 << 30);
            seeds = (first..).take(seeds.len()).collect();
            recorder.begin(first);
        }
        self.forest.seed_lanes(row, &seeds)?;
        let mut dice = seed.fork(RandomPurpose::LocalCars).dice();
        let begin = dice.random_range(0..=self.spec.horizon - self.spec.local_horizon);
        self.rows[row] = RowNow {
            dice,
            second: begin * self.plan.decision_steps,
            begun: begin * self.plan.decision_steps,
            shown_steps: 0,
            history: History::new(border),
            waiting: Waiting::default(),
        };
        self.doors.begin(row, &self.forest.rows[row]);
        Ok(())
    }

    /// Draws cars for the arrivals of a second of the decision.
    fn arrive(&mut self, second: usize, sources: &Rows<u8>) {
        for (row, now) in self.rows.iter_mut().enumerate() {
            let place = &self.forest.rows[row];
            let (agent, border) = (place.agent.0, &self.plan.borders[place.agent.0].plan);
            for entry in 0..border.entries.len() {
                if sources.row(row)[border.arrival(entry, second)] == 1 {
                    let what = [agent, entry, now.second];
                    match draw(border, &place.ways, &self.tables, what, &mut now.dice) {
                        Some(comer) => self.doors.come(row, entry, comer),
                        None => self.dropped += 1,
                    }
                }
            }
        }
    }

    /// Moves all rows on by a second of the decision.
    fn second(&mut self, second: usize, actions: &[Action], sources: &Rows<u8>) -> Result<()> {
        let begun = Instant::now();
        let before: Vec<Shown> = (0..self.rows.len()).map(|row| self.forest.handles.signal(row).shown()).collect();
        self.forest.handles.act(&mut self.forest.simulation, actions)?;
        self.arrive(second, sources);
        let tried = self.doors.let_in(&mut self.forest)?;
        self.watch.note(Phase::Insertion, begun.elapsed());
        self.watch.time(Phase::SimulatorStep, || self.forest.simulation.step())?;
        let begun = Instant::now();
        for (row, entry) in self.doors.note_entered(&mut self.forest, &tried)? {
            let border = &self.plan.borders[self.forest.rows[row].agent.0].plan;
            self.came_true.row_mut(row)[border.arrival(entry, second)] = 1;
        }
        self.watch.note(Phase::Insertion, begun.elapsed());
        let begun = Instant::now();
        for (row, (now, before)) in self.rows.iter_mut().zip(before).enumerate() {
            now.second += 1;
            let same = before == self.forest.handles.signal(row).shown();
            now.shown_steps = if same { now.shown_steps + 1 } else { 1 };
        }
        let is_last = second + 1 == self.plan.decision_steps;
        let needs_waiting = reward::needs_waiting(&self.plan.reward);
        if is_last || needs_waiting {
            self.forest.handles.read_cars(&mut self.forest.simulation, &mut self.cars)?;
        }
        if needs_waiting {
            for (row, now) in self.rows.iter_mut().enumerate() {
                now.waiting.note(self.forest.handles.cars_at(&self.cars, row));
            }
        }
        self.watch.note(Phase::Reading, begun.elapsed());
        self.recorder.as_mut().map_or(Ok(()), |recorder| recorder.step(&mut self.forest.simulation, tried.insertions()))
    }

    /// Writes what a row shows. `cars`: those on its approaches; `at_border`: those on the lanes of its border.
    fn show(&mut self, row: usize, [cars, at_border]: [CarsAt<'_>; 2]) {
        let (now, agent) = (&self.rows[row], self.forest.rows[row].agent.0);
        let (plan, border) = (&self.plan.agents[agent], &self.plan.borders[agent]);
        let signal = self.forest.handles.signal(row);
        let clock = now.second + plan.sensor.clock_ahead;
        let light = LightView { shown: signal.shown(), shown_steps: now.shown_steps, age: now.second, clock };
        let Percept { obs, d_set, masks } = &mut self.last.percept;
        observe::observe(plan, cars, light, obs.row_mut(row));
        border.d_set.write(&border.plan, at_border, light, &now.history, d_set.row_mut(row));
        let may_leave = signal.may_leave(&plan.phases);
        let mask = masks.as_mut().expect("agents of a scenario have masks").row_mut(row);
        for (action, allowed) in mask.iter_mut().enumerate() {
            *allowed = action < plan.phases.actions() && (may_leave || action == light.shown.target());
        }
    }

    /// Reads everything after a decision, and writes percepts and rewards of all rows.
    fn perceive(&mut self) -> Result<()> {
        self.forest.simulation.read_lanes(&self.border_lanes, &mut self.border_cars)?;
        if reward::needs_exits(&self.plan.reward) {
            self.forest.simulation.read_lanes(&self.exit_lanes, &mut self.exit_cars)?;
        }
        let [tables_cars, border_cars] = [&mut self.cars, &mut self.border_cars].map(std::mem::take);
        for row in 0..self.rows.len() {
            let agent = self.forest.rows[row].agent.0;
            let border = &self.plan.borders[agent].plan;
            self.rows[row].history.note(border, self.came_true.row(row));
            let cars = self.forest.handles.cars_at(&tables_cars, row);
            let at_border = CarsAt::new(&border_cars, self.first_border[row], border.lanes.len());
            let region = &self.plan.agents[agent].region;
            let exits = CarsAt::new(&self.exit_cars, self.first_exit[row], region.exits.len());
            self.last.rewards[row] = reward::reward(&self.plan.reward, region, cars, exits, &self.rows[row].waiting);
            if self.rows[row].second - self.rows[row].begun > SETTLED_S {
                self.counts.note(cars);
            }
            self.show(row, [cars, at_border]);
        }
        (self.cars, self.border_cars) = (tables_cars, border_cars);
        Ok(())
    }
}

impl LocalSimulator for LocalScenario {
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
        self.forest.handles.reset(&mut self.forest.simulation, &rows)?;
        begin.iter().try_for_each(|&beginning| self.begin(beginning))?;
        self.doors.set_gates(&mut self.forest, rows.iter().copied(), None)?;
        for row in rows {
            let agent = self.forest.rows[row].agent.0;
            let (approaches, lanes) =
                (self.plan.agents[agent].region.approaches.len(), self.plan.borders[agent].plan.lanes.len());
            let empty = nobody(approaches.max(lanes));
            self.show(row, [CarsAt::new(&empty, 0, approaches), CarsAt::new(&empty, 0, lanes)]);
        }
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        self.rows.iter_mut().for_each(|now| now.waiting.decide());
        self.came_true.fill(0);
        for (row, place) in self.forest.rows.iter().enumerate() {
            let blocked = self.plan.borders[place.agent.0].plan.all_blocked();
            self.came_true.row_mut(row)[blocked.clone()].copy_from_slice(&sources.row(row)[blocked]);
        }
        self.doors.set_gates(&mut self.forest, 0..self.rows.len(), Some(sources))?;
        for second in 0..self.plan.decision_steps {
            self.second(second, actions, sources)?;
        }
        let begun = Instant::now();
        self.perceive()?;
        self.watch.note(Phase::Reading, begun.elapsed());
        Ok(&self.last)
    }

    fn counters(&self) -> Vec<(&'static str, u64)> {
        let [came, waited] = self.doors.counts();
        let Counts { decisions, cars, speed_mmps } = self.counts;
        vec![
            ("sampled_arrivals", came + self.dropped),
            ("waited_arrivals", waited),
            (DROPPED, self.dropped),
            ("local_decisions", decisions),
            ("local_cars", cars),
            ("local_speed_mmps", speed_mmps),
        ]
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.watch.take()
    }
}

/// Returns a read of lanes without cars.
fn nobody(lanes: usize) -> CarTable {
    CarTable::of(vec![Vec::new(); lanes])
}
