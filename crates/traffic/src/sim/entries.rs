//! The entries of all rows of a forest, at which cars wait until there is room, and the exits, which can be blocked.
//!
//! # Why not otherwise
//!
//! **Why do cars not wait in SUMO's own queue?** SUMO tries all waiting cars of the process in one order, and a car that
//! enters changes what the next one finds. So a region would depend on its company.
//!
//! **Why is a car without room not dropped?** On the GS it would stand on the road before. A policy that lets its queue
//! grow to the border would be rewarded, because the cars that it keeps out would count nowhere. On the paper's grid it
//! is dropped all the same, as in the authors' simulator.
//!
//! **Why at most one car per lane and second?** Which of two goes first is up to SUMO.

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;

use super::arriving::ArrivingCar;
use super::local_forest::{FIRST_CAR, LocalForest, RowPlace};
use crate::agents::plan::JointPlan;
use crate::agents::region::EDGES;
use dials_core::base::Rows;
use dials_core::domain::Result;
use libsumo::{CarId, Entering, Insertion, LightId, SignalState};

pub(crate) struct Entries {
    plan: Arc<JointPlan>,
    rows: Vec<RowEntries>,
    next_car: u64,
    pub(crate) counts: EntryCounts,
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EntryCounts {
    pub(crate) came: u64,
    /// Number of cars that found no room at first, and waited.
    pub(crate) waited: u64,
    /// Number of cars that no entry let in. On a grid these are all that find no room at once.
    pub(crate) dropped: u64,
}

struct RowEntries {
    /// Cars that wait, by entry, the first one at the front.
    queues: Vec<VecDeque<WaitingCar>>,
    gate: Option<SignalState>,
}

struct WaitingCar {
    car: ArrivingCar,
    /// Whether it has found no room before.
    waited: bool,
}

/// Cars that try to enter in a step, in the order of their numbers.
pub(crate) struct Tried {
    pub(crate) places: Vec<(usize, usize)>,
    pub(crate) insertions: Vec<Insertion>,
    /// Which of them are buses, or other vehicles that carry many persons, with their rows.
    pub(crate) buses: Vec<(usize, CarId)>,
    /// Names of the types of all of them, and numbers of their routes. `None`: the usual type.
    pub(crate) kinds: Vec<(Option<String>, usize)>,
}

impl RowEntries {
    /// Nobody waits, and no exit was blocked or opened.
    fn new(plan: &JointPlan, place: &RowPlace) -> RowEntries {
        let entries = plan.borders.get(place.agent.0).map_or(EDGES, |border| border.plan.entries.len());
        RowEntries { queues: (0..entries).map(|_| VecDeque::new()).collect(), gate: None }
    }

    /// Returns the cars that try to enter in this second, with their entries: the first one of each entry, and at most
    /// one per lane. Two cars on a lane would depend on SUMO's order.
    fn first(&self) -> impl Iterator<Item = (usize, &ArrivingCar)> {
        let mut taken = Vec::new();
        let first = self.queues.iter().enumerate().filter_map(|(entry, queue)| Some((entry, &queue.front()?.car)));
        first.filter(move |(_, car)| {
            let is_free = !taken.contains(&car.lane);
            taken.push(car.lane);
            is_free
        })
    }
}

impl Entries {
    pub(crate) fn new(plan: Arc<JointPlan>, forest: &LocalForest) -> Entries {
        let rows = forest.rows.iter().map(|place| RowEntries::new(&plan, place)).collect();
        Entries {
            plan,
            rows,
            next_car: if forest.first.is_empty() { 0 } else { FIRST_CAR },
            counts: EntryCounts::default(),
        }
    }

    pub(super) fn begin(&mut self, row: usize, place: &RowPlace) {
        self.rows[row] = RowEntries::new(&self.plan, place);
    }

    pub(crate) fn waiting(&self, row: usize) -> usize {
        self.rows[row].queues.iter().map(VecDeque::len).sum()
    }

    /// Lets a car come to an entry of a row. It enters when there is room. `None`: none that may enter there.
    pub(crate) fn come(&mut self, row: usize, entry: usize, car: Option<ArrivingCar>) {
        self.counts.came += 1;
        match car {
            Some(car) => self.rows[row].queues[entry].push_back(WaitingCar { car, waited: false }),
            None => self.counts.dropped += 1,
        }
    }

    /// Returns a number that no car of the forest has.
    pub(crate) fn next_car(&mut self) -> u64 {
        self.next_car += 1;
        self.next_car - 1
    }

    /// Shows red at the exits that are blocked in this second of a decision, `[rows, sources]`, and green at the others;
    /// `None`: at all. Only where a part of the decision begins, there is something to do.
    pub(crate) fn set_gates(
        &mut self,
        forest: &mut LocalForest,
        rows: impl Iterator<Item = usize>,
        second: usize,
        sources: Option<&Rows<u8>>,
    ) -> Result<()> {
        let mut changed: Vec<(LightId, usize)> = Vec::new();
        for row in rows {
            let place = &forest.rows[row];
            let Some(gate) = &place.gate else { continue };
            let border = &self.plan.borders[place.agent.0].plan;
            if second > 0 && border.part_of(second) == border.part_of(second - 1) {
                continue;
            }
            let mut letters = vec!['G'; gate.letters];
            if let Some(sources) = sources {
                for (exit, letter) in gate.of_exit.iter().enumerate() {
                    if let Some(letter) = letter
                        && sources.row(row)[border.blocked(exit, border.part_of(second))] == 1
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
        Ok(forest.simulation.set_lights(&lights, &states)?)
    }

    pub(crate) fn let_in(&mut self, forest: &mut LocalForest) -> Result<Tried> {
        let mut tried = Tried { places: Vec::new(), insertions: Vec::new(), buses: Vec::new(), kinds: Vec::new() };
        let mut entering = Vec::new();
        for (row, entries) in self.rows.iter().enumerate() {
            let place = &forest.rows[row];
            for (entry, car) in entries.first() {
                let insertion = Insertion {
                    car: self.next_car + tried.places.len() as u64,
                    route: place.routes[car.route],
                    position_m: car.placement.position_m,
                    speed: car.placement.speed,
                };
                tried.places.push((row, entry));
                tried.buses.extend(car.is_bus.then_some((row, CarId(insertion.car))));
                tried.kinds.push((car.vehicle_type.clone(), car.route));
                tried.insertions.push(insertion);
                if let Some(border) = self.plan.borders.get(place.agent.0) {
                    entering.push(Entering {
                        insertion,
                        vehicle_type: forest.type_named(car.vehicle_type.as_deref()),
                        lane: Some(index_of(&border.plan.lanes[car.lane].lane)),
                        speed_factor: car.speed_factor,
                        end_m: place.local_routes.routes[car.route].end_m,
                    });
                }
            }
        }
        self.next_car += tried.places.len() as u64;
        // On a grid all cars are of the type `car` and on the only lane, which takes less time.
        if self.is_grid() {
            forest.simulation.insert(&tried.insertions)?;
        } else {
            forest.simulation.enter(&entering)?;
        }
        Ok(tried)
    }

    /// Takes the cars that have departed in the step out of the queues, wherever they are, and the others out of SUMO. So
    /// no car is on the road and still waits. On a grid the others are dropped. Returns row and entry of those that are in.
    pub(crate) fn note_entered(&mut self, forest: &mut LocalForest, tried: &Tried) -> Result<Vec<(usize, usize)>> {
        let mut entered = Vec::new();
        if tried.places.is_empty() {
            return Ok(entered);
        }
        let departed: HashSet<CarId> = forest.simulation.departed()?.into_iter().collect();
        let drops = self.is_grid();
        for (insertion, &(row, entry)) in tried.insertions.iter().zip(&tried.places) {
            let queue = &mut self.rows[row].queues[entry];
            if departed.contains(&CarId(insertion.car)) {
                queue.pop_front();
                entered.push((row, entry));
            } else if drops {
                queue.pop_front();
                self.counts.dropped += 1;
            } else {
                let first = queue.front_mut().expect("a car that tried is in the queue");
                self.counts.waited += u64::from(!std::mem::replace(&mut first.waited, true));
            }
        }
        if entered.len() < tried.places.len() {
            forest.simulation.clear_pending()?;
        }
        Ok(entered)
    }

    fn is_grid(&self) -> bool {
        self.plan.borders.is_empty()
    }
}

pub(crate) fn index_of(lane: &str) -> u32 {
    lane.rsplit_once('_').and_then(|(_, index)| index.parse().ok()).expect("SUMO's name of a lane ends with its index")
}
