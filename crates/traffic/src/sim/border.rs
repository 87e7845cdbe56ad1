//! What the GS sees of the borders of all regions: who arrives, which exits are blocked, and who visits.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::Arc;

use super::visits::{Arrival, VisitRecorder, Visits};
use crate::agents::border_plan::{BorderLane, BorderPlan};
use crate::agents::plan::{Border, JointPlan};
use crate::cars_at::RowLanes;
use crate::inflow::{History, SourceCounter, is_blocked};
use crate::network::roads::Signal;
use crate::observe::LightView;
use crate::scenario::stops::Stops;
use dials_core::base::Ragged;
use dials_core::domain::Result;
use libsumo::{CarId, LightId, SignalState, Simulation};

/// A trip that ends nearer to the end of a lane goes to its end, as far as anybody can see.
const NEAR_THE_END_M: f64 = 10.0;

/// A car that was slower, and is gone, did not end its trip. SUMO moved it out of a jam.
const STANDING_MPS: f64 = 1.0;

pub(crate) struct Borders {
    plan: Arc<JointPlan>,
    lanes: RowLanes,
    /// Lights at the ends of exits, and what they show.
    lights: Vec<LightId>,
    states: Vec<SignalState>,
    /// Places of the signals at the ends of exits, `[regions][exits]`: the light in the list above, and the letter.
    signals: Vec<Vec<Vec<(usize, usize)>>>,
    regions: Vec<BorderNow>,
    visits: Option<VisitRecorder>,
}

struct BorderNow {
    /// Cars that were on the region a second ago, with their lanes as indices into the plan, positions and speeds.
    present: HashMap<CarId, (usize, f64, f64)>,
    counter: SourceCounter,
    history: History,
}

impl BorderNow {
    fn new(plan: &BorderPlan) -> BorderNow {
        BorderNow { present: HashMap::new(), counter: SourceCounter::new(plan), history: History::new(plan) }
    }
}

impl Borders {
    /// Registers the lanes of all regions. A reset must follow.
    pub(super) fn register(simulation: &mut Simulation, plan: Arc<JointPlan>) -> Result<Borders> {
        let names = plan.borders.iter().map(|border| border.plan.lanes.iter().map(|lane| &lane.lane).collect());
        let all = plan.borders.iter().flat_map(|border| border.plan.exit_signals.iter().flatten());
        let names_of_lights: BTreeSet<&str> = all.map(|signal| &*signal.light).collect();
        let lights: Vec<&str> = names_of_lights.into_iter().collect();
        let place = |signal: &Signal| {
            let light = lights.binary_search(&&*signal.light).expect("all lights of exits are listed");
            (light, signal.letter)
        };
        let places = |signals: &Vec<Signal>| signals.iter().map(place).collect();
        let of_region = |border: &Border| border.plan.exit_signals.iter().map(places).collect();
        let signals = plan.borders.iter().map(of_region).collect();
        Ok(Borders {
            lanes: RowLanes::register(simulation, names)?,
            lights: simulation.register_lights(&lights)?,
            states: Vec::new(),
            signals,
            regions: plan.borders.iter().map(|border| BorderNow::new(&border.plan)).collect(),
            visits: None,
            plan,
        })
    }

    /// `stops`: where vehicles stop on their way.
    pub(crate) fn record_visits(&mut self, stops: Arc<Stops>) {
        self.visits = Some(VisitRecorder::new(self.regions.len(), stops));
    }

    pub(super) fn visits(&self) -> Option<&Visits> {
        self.visits.as_ref().map(|recorder| &recorder.visits)
    }

    /// Begins an episode. Cars that are on the road have not arrived.
    pub(super) fn reset(&mut self, simulation: &mut Simulation) -> Result<()> {
        self.lanes.read(simulation)?;
        for (row, Border { plan, .. }) in self.plan.borders.iter().enumerate() {
            self.regions[row] = BorderNow::new(plan);
            for (number, lane) in self.lanes.at(row).iter().enumerate() {
                let cars = lane.iter().map(|car| (car.id, (number, car.position_m, car.speed_mps)));
                self.regions[row].present.extend(cars);
            }
        }
        if let Some(visits) = &self.visits {
            self.record_visits(visits.stops.clone());
        }
        Ok(())
    }

    /// Observes a second. `second`: its number in the decision; `sources`: one row per region, zeros at first.
    pub(super) fn second(
        &mut self,
        simulation: &mut Simulation,
        second: usize,
        sources: &mut Ragged<u8>,
    ) -> Result<()> {
        self.lanes.read(simulation)?;
        simulation.read_lights(&self.lights, &mut self.states)?;
        let departures = simulation.departures()?;
        let gone = if self.visits.is_some() { simulation.gone()? } else { Vec::new() };
        let departed: HashSet<CarId> = departures.iter().map(|departure| departure.id).collect();
        self.visits.iter_mut().for_each(|visits| visits.second(&departures));
        for (row, Border { plan, .. }) in self.plan.borders.iter().enumerate() {
            let cars = self.lanes.at(row);
            let BorderNow { present, counter, history } = &mut self.regions[row];
            let before = std::mem::take(present);
            for (number, lane) in cars.iter().enumerate() {
                for car in lane.iter() {
                    present.insert(car.id, (number, car.position_m, car.speed_mps));
                    let stays = before.get(&car.id).is_some_and(|&(from, ..)| !plan.is_over_the_border(from, number));
                    if stays {
                        continue;
                    }
                    let border_lane = &plan.lanes[number];
                    let departed = departed.contains(&car.id);
                    let entry = border_lane.departures.filter(|_| departed).or(border_lane.entry);
                    entry.iter().for_each(|&entry| counter.arrived[entry] += 1);
                    if let Some(visits) = &mut self.visits
                        && let Some(name) = visits.name_of(car.id)
                    {
                        let route = simulation.route(name)?;
                        visits.arrived(row, plan, Arrival { car, lane: number, entry, departed, route });
                    }
                }
            }
            if let Some(visits) = &mut self.visits {
                let ended = gone.iter().filter(|car| !present.contains_key(car));
                for (car, &(lane, position_m, speed_mps)) in ended.filter_map(|car| Some((car, before.get(car)?))) {
                    let end_m = position_m + speed_mps;
                    let BorderLane { road, length_m, .. } = &plan.lanes[lane];
                    if let Some(road) = road.filter(|_| end_m < length_m - NEAR_THE_END_M && speed_mps > STANDING_MPS) {
                        visits.ended(row, *car, &plan.roads[road].road, end_m);
                    }
                }
            }
            for (exit, &lane) in plan.exits.iter().enumerate() {
                let signals = &self.signals[row][exit];
                let is_closed = |(light, letter): &(usize, usize)| {
                    self.states[*light].as_str().as_bytes().get(*letter).is_some_and(|&letter| !is_open(letter))
                };
                let is_held = !signals.is_empty() && signals.iter().all(is_closed);
                if is_held || is_blocked(cars.lane(lane), plan.lanes[lane].length_m) {
                    counter.blocked[exit * plan.parts() + plan.part_of(second)] = true;
                }
            }
            let sources = sources.row_mut(row);
            counter.end_second(plan, second, sources);
            if second + 1 == plan.decision_s {
                history.note(plan, sources);
            }
        }
        Ok(())
    }

    pub(super) fn d_separate(&self, row: usize, light: LightView, d_set: &mut [f32]) {
        let border = &self.plan.borders[row];
        border.d_set.write(&border.plan, self.lanes.at(row), light, &self.regions[row].history, d_set);
    }
}

/// Returns whether a signal lets cars on.
fn is_open(letter: u8) -> bool {
    !matches!(letter, b'r' | b'R' | b'u')
}
