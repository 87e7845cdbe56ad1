//! The doors of all rows of a forest: entries, at which cars wait until there is room, and exits, which can be blocked.

use std::collections::HashSet;
use std::sync::Arc;

use super::entrance::{Comer, Entrance};
use super::local_forest::{FIRST_CAR, LocalForest, RowPlace};
use crate::agents::border_plan::BorderPlan;
use crate::agents::plan::JointPlan;
use dials_core::base::Rows;
use dials_core::domain::Result;
use libsumo::{CarId, Entering, Insertion, LightId, SignalState};

/// The doors of a forest.
pub(crate) struct Doors {
    plan: Arc<JointPlan>,
    rows: Vec<RowDoors>,
    /// Number of the next car.
    serial: u64,
    came: u64,
    waited: u64,
}

struct RowDoors {
    entrance: Entrance,
    /// State of the light at the exits.
    gate: Option<SignalState>,
}

/// Cars that try to enter in a step, in the order of their numbers.
pub(crate) struct Tried {
    /// Row and entry of each.
    places: Vec<(usize, usize)>,
    insertions: Vec<Insertion>,
}

impl Tried {
    /// Returns what SUMO was told of each.
    pub(crate) fn insertions(&self) -> &[Insertion] {
        &self.insertions
    }
}

impl Doors {
    /// Makes the doors of a forest that was loaded. `plan`: that of the agents.
    pub(crate) fn new(plan: Arc<JointPlan>, forest: &LocalForest) -> Doors {
        let closed = |place: &RowPlace| RowDoors { entrance: Entrance::new(border(&plan, place)), gate: None };
        let rows = forest.rows.iter().map(closed).collect();
        Doors { plan, rows, serial: FIRST_CAR, came: 0, waited: 0 }
    }

    /// Begins an episode of a row: nobody waits.
    pub(crate) fn begin(&mut self, row: usize, place: &RowPlace) {
        self.rows[row] = RowDoors { entrance: Entrance::new(border(&self.plan, place)), gate: None };
    }

    /// Returns the number of cars that came, and of those that found no room at first, in all episodes.
    pub(crate) fn counts(&self) -> [u64; 2] {
        [self.came, self.waited]
    }

    /// Returns the number of cars that wait at the entries of a row.
    pub(crate) fn waiting(&self, row: usize) -> usize {
        self.rows[row].entrance.waiting()
    }

    /// Lets a car come to an entry of a row. It enters when there is room.
    pub(crate) fn come(&mut self, row: usize, entry: usize, comer: Comer) {
        self.rows[row].entrance.add(entry, comer);
        self.came += 1;
    }

    /// Returns a number that no car of the forest has.
    pub(crate) fn next_car(&mut self) -> u64 {
        self.serial += 1;
        self.serial - 1
    }

    /// Shows red at the exits that are blocked in this decision, `[rows, sources]`, and green at the others. `None`: green
    /// at all exits of all rows.
    pub(crate) fn set_gates(
        &mut self,
        forest: &mut LocalForest,
        rows: impl Iterator<Item = usize>,
        sources: Option<&Rows<u8>>,
    ) -> Result<()> {
        let mut changed: Vec<(LightId, usize)> = Vec::new();
        for row in rows {
            let place = &forest.rows[row];
            let Some(gate) = &place.gate else { continue };
            let border = border(&self.plan, place);
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
        Ok(forest.simulation.set_lights(&lights, &states)?)
    }

    /// Lets cars try to enter in the next step.
    pub(crate) fn let_in(&mut self, forest: &mut LocalForest) -> Result<Tried> {
        let mut places = Vec::new();
        let mut cars = Vec::new();
        for (row, doors) in self.rows.iter().enumerate() {
            for (entry, comer) in doors.entrance.next() {
                let car = self.serial + cars.len() as u64;
                cars.push(entering(&self.plan, forest, row, car, comer));
                places.push((row, entry));
            }
        }
        self.serial += cars.len() as u64;
        forest.simulation.enter(&cars)?;
        Ok(Tried { places, insertions: cars.into_iter().map(|car| car.insertion).collect() })
    }

    /// Takes the cars out of the queues that have departed in the step, wherever they are, and the others out of SUMO. So no
    /// car is on the road and still waits. No other car has got a number since they tried.
    ///
    /// Returns row and entry of the cars that are in.
    pub(crate) fn note_entered(&mut self, forest: &mut LocalForest, tried: &Tried) -> Result<Vec<(usize, usize)>> {
        let mut entered = Vec::new();
        if tried.places.is_empty() {
            return Ok(entered);
        }
        let departed: HashSet<CarId> = forest.simulation.departed()?.into_iter().collect();
        let first = self.serial - tried.places.len() as u64;
        for (number, &(row, entry)) in (first..).zip(&tried.places) {
            let is_in = departed.contains(&CarId(number));
            self.waited += u64::from(self.rows[row].entrance.tried(entry, is_in));
            entered.extend(is_in.then_some((row, entry)));
        }
        if entered.len() < tried.places.len() {
            forest.simulation.clear_pending()?;
        }
        Ok(entered)
    }
}

/// Returns what SUMO needs to know of a car that comes to a row. `car`: its number.
pub(crate) fn entering(plan: &JointPlan, forest: &LocalForest, row: usize, car: u64, comer: &Comer) -> Entering {
    let place = &forest.rows[row];
    Entering {
        insertion: Insertion { car, route: place.routes[comer.way], position_m: comer.position_m, speed: comer.speed },
        vehicle_type: forest.type_named(comer.vehicle_type.as_deref()),
        lane: Some(index_of(&border(plan, place).lanes[comer.lane].lane)),
        speed_factor: comer.speed_factor,
        end_m: place.ways.routes()[comer.way].end_m,
    }
}

fn border<'a>(plan: &'a JointPlan, place: &RowPlace) -> &'a BorderPlan {
    &plan.borders[place.agent.0].plan
}

/// Returns the index of a lane on its road: SUMO's names end with it.
fn index_of(lane: &str) -> u32 {
    lane.rsplit_once('_').and_then(|(_, index)| index.parse().ok()).expect("SUMO's name of a lane ends with its index")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::Traffic;
    use crate::agents::border_plan::EntryPlace;
    use crate::config::ScenarioConfig;
    use crate::sim::entrance::comer;
    use dials_core::base::{AgentId, Seed};

    #[test]
    fn a_car_that_enters_on_another_road_than_expected_enters_once() {
        let scenario = "../../sumo_nets/grid_4x4_turns/grid_4x4_turns.sumocfg";
        let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join(scenario);
        let minutes = ScenarioConfig { begin_s: Some(0), end_s: Some(120), ..ScenarioConfig::new(scenario) };
        let traffic = Traffic::open_scenario(&minutes).unwrap();
        let (agent, tables) = (AgentId(5), traffic.visits().unwrap());
        let parts = traffic.ground.local_parts().unwrap().unwrap();
        let mut forest = LocalForest::load(&parts, &traffic.plan, &tables, (&[agent], 1), Seed::new(0)).unwrap();
        let border = &traffic.plan.borders[agent.0].plan;
        let mut visits = tables.visits().of_agents[agent.0].iter();
        let found = visits.find_map(|visit| Some((visit.entry.filter(|_| !visit.way.is_empty())?, visit)));
        let (entry, visit) = found.expect("cars come to the region");
        let mut comer = comer(border, &forest.rows[0].ways, entry, visit).unwrap();
        // SUMO is told the index of the lane and the way. So the car begins on the first road of its way.
        let index = index_of(&border.lanes[comer.lane].lane);
        let elsewhere = border.entries.iter().find_map(|other| match other.place {
            EntryPlace::Lane(lane) => {
                (index_of(&border.lanes[lane].lane) == index && !border.is_on_road(lane, &visit.way[0])).then_some(lane)
            }
            EntryPlace::Road(_) => None,
        });
        comer.lane = elsewhere.expect("another road has a lane of this index");
        let mut doors = Doors::new(traffic.plan.clone(), &forest);
        doors.come(0, entry, comer);
        let tried = [(); 3].map(|()| {
            let tried = doors.let_in(&mut forest).unwrap();
            forest.simulation.step().unwrap();
            let entered = doors.note_entered(&mut forest, &tried).unwrap();
            (tried.insertions().len(), entered)
        });
        assert_eq!((tried, doors.waiting(0)), ([(1, vec![(0, entry)]), (0, vec![]), (0, vec![])], 0));
    }
}
