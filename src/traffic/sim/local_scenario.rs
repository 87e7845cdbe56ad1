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

use super::entrance::{Entrance, draw};
use super::global::starts;
use super::local_forest::{FIRST_CAR, LocalForest, LocalParts, RowPlace};
use super::recorded_local::roads_of;
use super::recording::{Recorder, Tape};
use super::visit_tables::VisitTables;
use crate::base::{AgentId, Dice, Phase, RandomPurpose, Rows, Seed, Stopwatch};
use crate::domain::{Action, Beginning, LocalSimulator, Percept, RegionSpec, Result, Transition};
use crate::sumo::{CarId, CarTable, Entering, Insertion, LaneId, LightId, SignalState, TypeId};
use crate::traffic::agents::phase_plan::Shown;
use crate::traffic::agents::plan::JointPlan;
use crate::traffic::cars_at::CarsAt;
use crate::traffic::cut::mixed::prefix;
use crate::traffic::inflow::History;
use crate::traffic::observe::{self, LightView};
use crate::traffic::reward::{self, Waiting};

/// The traffic LS of a scenario: one row per copy of a region.
///
/// A row draws from random numbers of its own only. Those of SUMO are seeded lane by lane when its episode begins.
pub struct LocalScenario {
    spec: RegionSpec,
    plan: Arc<JointPlan>,
    tables: Arc<VisitTables>,
    forest: LocalForest,
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
    last: Transition,
    serial: u64,
    sampled: u64,
    waited: u64,
    watch: Stopwatch,
    recorder: Option<Recorder>,
}

/// The episode of a row.
struct RowNow {
    dice: Dice,
    /// Second of the demand.
    second: usize,
    /// Number of seconds for which the light has shown what it shows.
    shown_steps: u32,
    entrance: Entrance,
    history: History,
    waiting: Waiting,
    /// State of the light at the exits.
    gate: Option<SignalState>,
}

/// A car that tries to enter in a second.
struct Attempt {
    row: usize,
    entry: usize,
    lane: LaneId,
    insertion: Insertion,
}

impl LocalScenario {
    /// Loads `copies` of each of these regions. `tables`: from which cars are drawn.
    pub fn load(
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
                shown_steps: 0,
                entrance: Entrance::new(border),
                history: History::new(border),
                waiting: Waiting::default(),
                gate: None,
            }
        };
        Ok(LocalScenario {
            rows: forest.rows.iter().map(row).collect(),
            border_cars: nobody(border_lanes.len()),
            exit_cars: nobody(exit_lanes.len()),
            cars: CarTable::new(),
            last: Transition::new(forest.rows.len(), &spec),
            border_lanes,
            first_border,
            exit_lanes,
            first_exit,
            serial: FIRST_CAR,
            sampled: 0,
            waited: 0,
            watch: Stopwatch::default(),
            recorder: None,
            spec,
            plan: plan.clone(),
            tables,
            forest,
        })
    }

    /// Makes the first episode of the first row go on this tape. `parts`: what it was loaded from.
    pub fn record_on(mut self, tape: &Tape, parts: &LocalParts) -> Result<LocalScenario> {
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
        let mut seeds: Vec<u32> = place.lanes.iter().map(|_| of_lanes.random()).collect();
        if let Some(recorder) = self.recorder.as_mut().filter(|_| row == 0) {
            // Plain SUMO, which plays the recording again, seeds the lanes with the numbers from its own seed on.
            let first = of_lanes.random_range(0..1 << 30);
            seeds = (first..).take(seeds.len()).collect();
            recorder.begin(first);
        }
        self.forest.simulation.seed_lanes(place.first_lane, &seeds)?;
        let mut dice = seed.fork(RandomPurpose::LocalCars).dice();
        let begin = dice.random_range(0..=self.spec.horizon - self.spec.local_horizon);
        self.rows[row] = RowNow {
            dice,
            second: begin * self.plan.decision_steps,
            shown_steps: 0,
            entrance: Entrance::new(border),
            history: History::new(border),
            waiting: Waiting::default(),
            gate: None,
        };
        Ok(())
    }

    /// Shows red at the exits that are blocked in this decision, `[rows, sources]`, and green at the others. `None`: green
    /// at all exits of all rows.
    fn set_gates(&mut self, rows: impl Iterator<Item = usize>, sources: Option<&Rows<u8>>) -> Result<()> {
        let mut changed: Vec<(LightId, usize)> = Vec::new();
        for row in rows {
            let place = &self.forest.rows[row];
            let Some(gate) = &place.gate else { continue };
            let border = &self.plan.borders[place.agent.0].plan;
            let mut letters = vec!['G'; gate.letters];
            if let Some(sources) = sources {
                for (exit, letter) in gate.of_exit.iter().enumerate() {
                    if let Some(letter) = letter
                        && sources.row(row)[border.blocked(exit)] == 1
                    {
                        letters[*letter] = 'r';
                    }
                }
            }
            let state = Some(SignalState::new(letters.into_iter().collect::<String>())?);
            if self.rows[row].gate != state {
                self.rows[row].gate = state;
                changed.push((gate.light, row));
            }
        }
        let (lights, rows): (Vec<LightId>, Vec<usize>) = changed.into_iter().unzip();
        let states: Vec<&SignalState> = rows.iter().filter_map(|&row| self.rows[row].gate.as_ref()).collect();
        Ok(self.forest.simulation.set_lights(&lights, &states)?)
    }

    /// Draws cars for the arrivals of a second of the decision.
    fn arrive(&mut self, second: usize, sources: &Rows<u8>) {
        for (row, now) in self.rows.iter_mut().enumerate() {
            let place = &self.forest.rows[row];
            let (agent, border) = (place.agent.0, &self.plan.borders[place.agent.0].plan);
            for entry in 0..border.entries.len() {
                if sources.row(row)[border.arrival(entry, second)] == 1 {
                    let what = [agent, entry, now.second];
                    let comer = draw(border, &place.ways, &self.tables, what, &mut now.dice);
                    now.entrance.add(entry, comer);
                    self.sampled += 1;
                }
            }
        }
    }

    /// Lets cars try to enter in the next step. Returns the attempts in the order of the cars' numbers.
    fn let_in(&mut self) -> Result<Vec<Attempt>> {
        let mut tried = Vec::new();
        let mut cars = Vec::new();
        for (row, now) in self.rows.iter().enumerate() {
            let place = &self.forest.rows[row];
            for (entry, comer) in now.entrance.next() {
                let lane = &self.plan.borders[place.agent.0].plan.lanes[comer.lane];
                let insertion = Insertion {
                    car: self.serial + cars.len() as u64,
                    route: place.routes[comer.way],
                    position_m: comer.position_m,
                    speed: comer.speed,
                };
                cars.push(Entering {
                    insertion,
                    vehicle_type: type_of(&self.forest.types, comer.vehicle_type.as_deref()),
                    lane: index_of(&lane.lane),
                    speed_factor: comer.speed_factor,
                    end_m: place.ways.routes()[comer.way].end_m,
                });
                tried.push(Attempt { row, entry, lane: place.border[comer.lane], insertion });
            }
        }
        self.forest.simulation.enter(&cars)?;
        Ok(tried)
    }

    /// Takes the cars out of the queues that are in, and the others out of SUMO.
    fn note_entered(&mut self, tried: &[Attempt]) -> Result<()> {
        let lanes: Vec<LaneId> = tried.iter().map(|attempt| attempt.lane).collect();
        let mut cars = CarTable::new();
        self.forest.simulation.read_lanes(&lanes, &mut cars)?;
        let mut all_in = true;
        for (number, Attempt { row, entry, insertion, .. }) in tried.iter().enumerate() {
            let is_in = cars.lane(number).ids.contains(&CarId(insertion.car));
            self.waited += u64::from(self.rows[*row].entrance.tried(*entry, is_in));
            all_in &= is_in;
        }
        self.serial += tried.len() as u64;
        if !all_in {
            self.forest.simulation.clear_pending()?;
        }
        Ok(())
    }

    /// Moves all rows on by a second of the decision.
    fn second(&mut self, second: usize, actions: &[Action], sources: &Rows<u8>) -> Result<()> {
        let begun = Instant::now();
        let before: Vec<Shown> = (0..self.rows.len()).map(|row| self.forest.handles.signal(row).shown()).collect();
        self.forest.handles.act(&mut self.forest.simulation, actions)?;
        self.arrive(second, sources);
        let tried = self.let_in()?;
        self.watch.note(Phase::Insertion, begun.elapsed());
        self.watch.time(Phase::SimulatorStep, || self.forest.simulation.step())?;
        let begun = Instant::now();
        self.note_entered(&tried)?;
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
        let Some(recorder) = &mut self.recorder else { return Ok(()) };
        let insertions: Vec<Insertion> = tried.iter().map(|attempt| attempt.insertion).collect();
        recorder.step(&mut self.forest.simulation, &insertions)
    }

    /// Writes what a row shows. `cars`: those on its approaches; `at_border`: those on the lanes of its border.
    fn show(&mut self, row: usize, [cars, at_border]: [CarsAt<'_>; 2]) {
        let (now, agent) = (&self.rows[row], self.forest.rows[row].agent.0);
        let (plan, border) = (&self.plan.agents[agent], &self.plan.borders[agent]);
        let signal = self.forest.handles.signal(row);
        let light = LightView { shown: signal.shown(), shown_steps: now.shown_steps, age: now.second };
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
    fn perceive(&mut self, sources: &Rows<u8>) -> Result<()> {
        self.forest.simulation.read_lanes(&self.border_lanes, &mut self.border_cars)?;
        if reward::needs_exits(&self.plan.reward) {
            self.forest.simulation.read_lanes(&self.exit_lanes, &mut self.exit_cars)?;
        }
        let [tables_cars, border_cars] = [&mut self.cars, &mut self.border_cars].map(std::mem::take);
        for row in 0..self.rows.len() {
            let agent = self.forest.rows[row].agent.0;
            let border = &self.plan.borders[agent].plan;
            self.rows[row].history.note(border, sources.row(row));
            let cars = self.forest.handles.cars_at(&tables_cars, row);
            let at_border = CarsAt::new(&border_cars, self.first_border[row], border.lanes.len());
            let region = &self.plan.agents[agent].region;
            let exits = CarsAt::new(&self.exit_cars, self.first_exit[row], region.exits.len());
            self.last.rewards[row] = reward::reward(&self.plan.reward, region, cars, exits, &self.rows[row].waiting);
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
        self.set_gates(rows.iter().copied(), None)?;
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
        self.set_gates(0..self.rows.len(), Some(sources))?;
        for second in 0..self.plan.decision_steps {
            self.second(second, actions, sources)?;
        }
        let begun = Instant::now();
        self.perceive(sources)?;
        self.watch.note(Phase::Reading, begun.elapsed());
        Ok(&self.last)
    }

    fn counters(&self) -> Vec<(&'static str, u64)> {
        vec![("sampled_arrivals", self.sampled), ("backlog", self.waited)]
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.watch.take()
    }
}

/// Returns a read of lanes without cars.
fn nobody(lanes: usize) -> CarTable {
    CarTable::of(vec![Vec::new(); lanes])
}

/// Returns the number of a vehicle type. `None`: of the usual one.
fn type_of(types: &[(String, TypeId)], name: Option<&str>) -> TypeId {
    let named = name.and_then(|name| types.iter().find(|(other, _)| other == name));
    named.unwrap_or(&types[0]).1
}

/// Returns the index of a lane on its road: SUMO's names end with it.
fn index_of(lane: &str) -> u32 {
    lane.rsplit_once('_').and_then(|(_, index)| index.parse().ok()).expect("SUMO's name of a lane ends with its index")
}
