//! How far the local simulators (LS) of the lights are like the global simulator (GS), measured.
//!
//! The GS plays one episode under random greens. The LS of each light then plays it again: the same greens, the same
//! blocked exits, and the cars that came to its region, of the same types and ways. It does so twice. With *true entries*
//! every car begins exactly where and as fast as it was seen first. With *sampled entries* it comes as cars come in
//! training: by the entry rule, at the true second and on the true lane. Where the two simulators have cars is compared,
//! second by second, in cells of 10 m of the approaches.

pub mod agreement;
pub mod doubts;
pub mod truth;

use std::ops::Range;
use std::sync::Arc;

use super::Traffic;
use super::road_network::Files;
use crate::agents::border_plan::BorderPlan;
use crate::agents::region::EDGES;
use crate::inflow::has_arrival;
use crate::sim::arriving::ArrivingCar;
use crate::sim::entries::{Entries, index_of};
use crate::sim::local::Placement;
use crate::sim::local_forest::{LocalForest, LocalParts, rows_of};
use crate::sim::visit_tables::VisitTables;
use crate::sim::visits::{Driver, Visit};
use agreement::{Comparison, Seen};
use dials_core::base::{AgentId, RandomPurpose, Rows, Seed};
use dials_core::domain::{Beginning, LocalSimulator, Result};
pub use doubts::Causes;
use libsumo::{CarTable, DepartSpeed, Entering as EnteringCar, Error, Insertion, Placing};
use truth::Truth;

#[derive(Clone, Debug, PartialEq)]
pub struct LightFidelity {
    pub agent: AgentId,
    pub light: String,
    /// GS and LS if cars begin exactly as they were seen first.
    pub true_entries: Comparison,
    /// GS and LS if cars come in as in training.
    pub sampled_entries: Comparison,
    /// Two LSs with true entries and other random numbers of SUMO. `None`: nothing is random.
    pub other_seed: Option<Comparison>,
    pub causes: Causes,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Entering {
    Truly,
    ByRule,
}

pub struct Fidelity<'a> {
    traffic: &'a Traffic,
    truth: &'a Truth,
    window: Range<usize>,
    scenario: Option<(Arc<LocalParts>, VisitTables)>,
}

impl<'a> Fidelity<'a> {
    /// Prepares to compare the seconds `window` of a recorded episode. Nothing of it is simulated yet.
    pub fn new(traffic: &'a Traffic, truth: &'a Truth, window: Range<usize>) -> Result<Fidelity<'a>> {
        let visits = || VisitTables::new(truth.visits.clone().unwrap_or_default(), &traffic.plan.borders);
        let scenario = match &traffic.network.files {
            Files::Scenario(files) => Some((files.local_parts()?, visits())),
            Files::Grid(_) => None,
        };
        Ok(Fidelity { traffic, truth, window, scenario })
    }

    /// Measures a light. SUMO must not be loaded elsewhere in this process.
    pub fn measure(&self, agent: AgentId) -> Result<LightFidelity> {
        let plan = &self.traffic.plan.agents[agent.0];
        let of_gs = self.truth.seen(plan, &self.window)?;
        let seed = self.truth.seed.for_agent(agent);
        let play = |entering, copy| match &self.scenario {
            Some((parts, tables)) => self.play_on_scenario((parts, tables), agent, entering, seed.for_copy(copy)),
            None => self.play_on_grid(agent, entering),
        };
        let true_entries = play(Entering::Truly, 0)?;
        let sampled_entries = play(Entering::ByRule, 0)?;
        let other_seed = match self.traffic.network.is_random {
            true => Some(Comparison::of(&true_entries, &play(Entering::Truly, 1)?)),
            false => None,
        };
        Ok(LightFidelity {
            agent,
            light: plan.light.clone(),
            causes: Causes::of(self.truth, self.traffic, agent, &self.window)?,
            true_entries: Comparison::of(&of_gs, &true_entries),
            sampled_entries: Comparison::of(&of_gs, &sampled_entries),
            other_seed,
        })
    }

    /// Plays the whole recording at a light of a grid. Nothing in it is random.
    fn play_on_grid(&self, agent: AgentId, entering: Entering) -> Result<Seen> {
        let plan = &self.traffic.plan.agents[agent.0];
        let mut ls = self.traffic.local(1)?;
        ls.reset(&Beginning::first([0]))?;
        let mut seen = Seen::new(plan, self.window.clone());
        let mut before = CarTable::of(vec![Vec::new(); EDGES]);
        let recorded = self.truth.actions.iter().zip(&self.truth.sources).zip(self.truth.on_approaches(plan)?);
        for ((actions, sources), now) in recorded {
            let actions = &actions[agent.0..=agent.0];
            match entering {
                Entering::ByRule => ls.step(actions, &Rows::from_vec(sources.row(agent.0).to_vec(), EDGES))?,
                Entering::Truly => ls.step_with(actions, &[placements(&now, &before)])?,
            };
            seen.note(plan, ls.cars_on(0), &[], 0); // Trips end behind the intersection.
            before = now;
        }
        let counted = ls.counters();
        [seen.sums.came, seen.sums.dropped] = [counted[0].1, counted[1].1];
        Ok(seen)
    }

    /// Plays the whole recording at a light. `seed`: of SUMO's random numbers.
    fn play_on_scenario(
        &self,
        (parts, tables): (&LocalParts, &VisitTables),
        agent: AgentId,
        entering: Entering,
        seed: Seed,
    ) -> Result<Seen> {
        let (joint, plan) = (&self.traffic.plan, &self.traffic.plan.agents[agent.0]);
        let border = &joint.borders[agent.0].plan;
        let mut forest = LocalForest::of_scenario(parts, joint, tables, &rows_of(&[agent], 1, seed))?;
        let seeds = forest.draw_seeds(0, &mut seed.fork(RandomPurpose::Lanes).dice());
        forest.seed_lanes(0, &seeds)?;
        forest.lights.reset(&mut forest.simulation, &[0])?;
        let mut entries = Entries::new(joint.clone(), &forest);
        let mut seen = Seen::new(plan, self.window.clone());
        let recorded = tables.visits();
        let mut visits = recorded.of_agents[agent.0].iter().peekable();
        let mut lost = 0;
        for (decision, (actions, sources)) in self.truth.actions.iter().zip(&self.truth.sources).enumerate() {
            let sources = sources.row(agent.0);
            let sources = Rows::from_vec(sources.to_vec(), sources.len());
            for second in 0..joint.decision_steps {
                entries.set_gates(&mut forest, 0..1, second, Some(&sources))?;
                let second = decision * joint.decision_steps + second;
                forest.lights.act(&mut forest.simulation, &actions[agent.0..=agent.0])?;
                let mut come: Vec<&Visit> = Vec::new();
                while let Some(visit) = visits.next_if(|visit| visit.second <= second) {
                    come.extend((!visit.way.is_empty()).then_some(visit));
                }
                match entering {
                    Entering::ByRule => {
                        for visit in come {
                            let Some(entry) = visit.entry else { continue };
                            let routes = &forest.rows[0].local_routes;
                            match ArrivingCar::of(border, routes, entry, visit, recorded.driver(visit)) {
                                None => lost += 1,
                                car => entries.come(0, entry, car),
                            }
                        }
                        forest.simulation.begin_second()?;
                        let tried = entries.let_in(&mut forest)?;
                        forest.simulation.step()?;
                        entries.note_entered(&mut forest, &tried)?;
                    }
                    Entering::Truly => {
                        forest.simulation.second()?;
                        for visit in come {
                            let driver = recorded.driver(visit);
                            lost += u64::from(!put(&mut forest, &mut entries, border, visit, driver)?);
                        }
                    }
                }
                forest.approaches.read(&mut forest.simulation)?;
                let gone = forest.simulation.gone()?;
                seen.note(plan, forest.approaches.at(0), &gone, entries.waiting(0));
            }
        }
        [seen.sums.came, seen.sums.waited] = [entries.counts.came, entries.counts.waited];
        seen.sums.lost = lost;
        Ok(seen)
    }
}

/// Returns where and how fast a car came to each edge between two reads.
fn placements(now: &CarTable, before: &CarTable) -> [Option<Placement>; EDGES] {
    std::array::from_fn(|edge| {
        let [now, before] = [now, before].map(|cars| cars.lane(edge));
        let car = now.iter().next().filter(|_| has_arrival(now, before));
        car.map(|car| Placement { position_m: car.position_m, speed: DepartSpeed::Fixed(car.speed_mps) })
    })
}

/// Puts a car exactly where it was seen first. Returns whether SUMO can: one that SUMO moved may stand beside its way.
///
/// SUMO 1.15 crashes when it puts a car somewhere that has a stop. Such a car enters in the next second instead, if there is room.
fn put(
    forest: &mut LocalForest,
    entries: &mut Entries,
    border: &BorderPlan,
    visit: &Visit,
    driver: &Driver,
) -> Result<bool> {
    let car = entries.next_car();
    let place = &forest.rows[0];
    let route = place.local_routes.number(visit);
    let entering = EnteringCar {
        insertion: Insertion { car, route: place.routes[route], position_m: 0.0, speed: DepartSpeed::Max },
        vehicle_type: forest.type_named(Some(&driver.vehicle_type)),
        lane: None,
        speed_factor: driver.speed_factor,
        end_m: place.local_routes.routes[route].end_m,
    };
    if !visit.stops.is_empty() {
        let lane = &border.lanes[visit.lane];
        let is_at_begin = visit.way.first().is_some_and(|road| border.is_on_road(visit.lane, road));
        let ahead_m = (visit.position_m + visit.speed_mps).min(lane.length_m - 0.1).max(0.0);
        let insertion = Insertion { position_m: if is_at_begin { ahead_m } else { 0.0 }, ..entering.insertion };
        let lane = is_at_begin.then(|| index_of(&lane.lane));
        forest.simulation.enter(&[EnteringCar { insertion, lane, ..entering }])?;
        return Ok(true);
    }
    let placing =
        Placing { car, lane: place.border[visit.lane], position_m: visit.position_m, speed_mps: visit.speed_mps };
    forest.simulation.enter(&[entering])?;
    match forest.simulation.place(&[placing]) {
        Ok(()) => Ok(true),
        Err(Error::Refused { .. }) => {
            forest.simulation.clear_pending()?;
            Ok(false)
        }
        Err(error) => Err(error.into()),
    }
}
