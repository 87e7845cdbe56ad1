//! The LS of a scenario's light plays the recorded episode again.

use super::agreement::Seen;
use super::{Entering, Fidelity};
use crate::sim::doors::Doors;
use crate::sim::entrance::comer;
use crate::sim::local_forest::{LocalForest, LocalParts};
use crate::sim::visit_tables::VisitTables;
use crate::sim::visits::Visit;
use dials_core::base::{AgentId, RandomPurpose, Rows, Seed};
use dials_core::domain::Result;
use libsumo::{CarTable, DepartSpeed, Entering as EnteringCar, Error, Insertion, Placing};

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
        let mut forest = LocalForest::load(parts, joint, tables, (&[agent], 1), seed)?;
        let seeds = forest.draw_seeds(0, &mut seed.fork(RandomPurpose::Lanes).dice());
        forest.seed_lanes(0, &seeds)?;
        forest.handles.reset(&mut forest.simulation, &[0])?;
        let mut doors = Doors::new(joint.clone(), &forest);
        let mut seen = Seen::new(plan, self.window.clone());
        let mut visits = tables.visits().of_agents[agent.0].iter().peekable();
        let mut cars = CarTable::new();
        let mut lost = 0;
        for (decision, (actions, sources)) in self.truth.actions.iter().zip(&self.truth.sources).enumerate() {
            let sources = sources.row(agent.0);
            doors.set_gates(&mut forest, 0..1, Some(&Rows::from_vec(sources.to_vec(), sources.len())))?;
            for second in 0..joint.decision_steps {
                let second = decision * joint.decision_steps + second;
                forest.handles.act(&mut forest.simulation, &actions[agent.0..=agent.0])?;
                let mut come: Vec<&Visit> = Vec::new();
                while let Some(visit) = visits.next_if(|visit| visit.second <= second) {
                    come.extend((!visit.way.is_empty()).then_some(visit));
                }
                match entering {
                    Entering::ByRule => {
                        for visit in come {
                            let Some(entry) = visit.entry else { continue };
                            match comer(border, &forest.rows[0].ways, entry, visit) {
                                Some(comer) => doors.come(0, entry, comer),
                                None => lost += 1,
                            }
                        }
                        let tried = doors.let_in(&mut forest)?;
                        forest.simulation.step()?;
                        doors.note_entered(&mut forest, &tried)?;
                    }
                    Entering::Truly => {
                        forest.simulation.step()?;
                        for visit in come {
                            lost += u64::from(!put(&mut forest, &mut doors, visit)?);
                        }
                    }
                }
                forest.handles.read_cars(&mut forest.simulation, &mut cars)?;
                let gone = forest.simulation.gone()?;
                seen.note(plan, forest.handles.cars_at(&cars, 0), &gone, doors.waiting(0));
            }
        }
        [seen.sums.came, seen.sums.waited] = doors.counts();
        seen.sums.lost = lost;
        Ok(seen)
    }
}

/// Puts a car into the only row of a forest, exactly as it was seen first. Returns whether SUMO can: a car that was moved
/// past a jam may stand beside its way.
fn put(forest: &mut LocalForest, doors: &mut Doors, visit: &Visit) -> Result<bool> {
    let car = doors.next_car();
    let place = &forest.rows[0];
    let way = place.ways.number(&visit.way, visit.next_road.as_ref());
    let entering = EnteringCar {
        insertion: Insertion { car, route: place.routes[way], position_m: 0.0, speed: DepartSpeed::Max },
        vehicle_type: forest.type_named(Some(&visit.driver.vehicle_type)),
        lane: None,
        speed_factor: visit.driver.speed_factor,
        end_m: place.ways.routes()[way].end_m,
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
