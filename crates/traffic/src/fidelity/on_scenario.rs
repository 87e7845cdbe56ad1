//! The LS of a scenario's light plays the recorded episode again.

use super::agreement::Seen;
use super::{Entering, Fidelity};
use crate::sim::arriving::ArrivingCar;
use crate::sim::entries::Entries;
use crate::sim::local_forest::{LocalForest, LocalParts, rows_of};
use crate::sim::visit_tables::VisitTables;
use crate::sim::visits::{Driver, Visit};
use dials_core::base::{AgentId, RandomPurpose, Rows, Seed};
use dials_core::domain::Result;
use libsumo::{DepartSpeed, Entering as EnteringCar, Error, Insertion, Placing};

impl Fidelity<'_> {
    /// Plays the whole recording at a light. `seed`: of SUMO's random numbers.
    pub(super) fn play_on_scenario(
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
            entries.set_gates(&mut forest, 0..1, Some(&Rows::from_vec(sources.to_vec(), sources.len())))?;
            for second in 0..joint.decision_steps {
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
                        let tried = entries.let_in(&mut forest)?;
                        forest.simulation.step()?;
                        entries.note_entered(&mut forest, &tried)?;
                    }
                    Entering::Truly => {
                        forest.simulation.step()?;
                        for visit in come {
                            let driver = recorded.driver(visit);
                            lost += u64::from(!put(&mut forest, &mut entries, visit, driver)?);
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

/// Puts a car into the only row of a forest, exactly as it was seen first. Returns whether SUMO can: a car that was moved
/// past a jam may stand beside its way.
fn put(forest: &mut LocalForest, entries: &mut Entries, visit: &Visit, driver: &Driver) -> Result<bool> {
    let car = entries.next_car();
    let place = &forest.rows[0];
    let route = place.local_routes.number(&visit.way, visit.next_road.as_ref());
    let entering = EnteringCar {
        insertion: Insertion { car, route: place.routes[route], position_m: 0.0, speed: DepartSpeed::Max },
        vehicle_type: forest.type_named(Some(&driver.vehicle_type)),
        lane: None,
        speed_factor: driver.speed_factor,
        end_m: place.local_routes.routes[route].end_m,
    };
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
