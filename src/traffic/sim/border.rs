//! What the GS (global simulator) sees of the borders of all regions: who arrives, and which exits are
//! blocked.

use std::collections::HashSet;

use super::global::starts;
use crate::base::Ragged;
use crate::domain::Result;
use crate::sumo::{CarId, CarTable, LaneId, Simulation};
use crate::traffic::agents::border_plan::BorderPlan;
use crate::traffic::agents::plan::Border;
use crate::traffic::cars_at::CarsAt;
use crate::traffic::inflow::{History, SourceCounter, is_blocked};
use crate::traffic::observe::LightView;

/// The borders of all regions in a loaded net.
pub struct Borders {
    /// Lanes of all regions, one region after the other, and the first one of each.
    lanes: Vec<LaneId>,
    first: Vec<usize>,
    cars: CarTable,
    regions: Vec<BorderNow>,
}

/// The border of one region in this second.
struct BorderNow {
    /// Cars that were on the region a second ago.
    present: HashSet<CarId>,
    counter: SourceCounter,
    history: History,
}

impl BorderNow {
    fn new(plan: &BorderPlan) -> BorderNow {
        BorderNow { present: HashSet::new(), counter: SourceCounter::new(plan), history: History::new(plan) }
    }
}

impl Borders {
    /// Registers the lanes of all regions. A reset must follow.
    pub fn register(simulation: &mut Simulation, plans: &[Border]) -> Result<Borders> {
        let names: Vec<String> =
            plans.iter().flat_map(|border| &border.plan.lanes).map(|lane| lane.lane.clone()).collect();
        Ok(Borders {
            lanes: simulation.register_lanes(&names)?,
            first: starts(plans.iter().map(|border| border.plan.lanes.len())),
            cars: CarTable::new(),
            regions: plans.iter().map(|border| BorderNow::new(&border.plan)).collect(),
        })
    }

    /// Begins an episode. Cars that are on the road have not arrived.
    pub fn reset(&mut self, simulation: &mut Simulation, plans: &[Border]) -> Result<()> {
        simulation.read_lanes(&self.lanes, &mut self.cars)?;
        for (row, Border { plan, .. }) in plans.iter().enumerate() {
            self.regions[row] = BorderNow::new(plan);
            let cars = CarsAt::new(&self.cars, self.first[row], plan.lanes.len());
            self.regions[row].present.extend(cars.iter().flat_map(|lane| lane.ids));
        }
        Ok(())
    }

    /// Observes a second. `second`: its number within the decision; `sources`: those of the decision, one row per
    /// region, zeros in the first second.
    pub fn second(
        &mut self,
        simulation: &mut Simulation,
        plans: &[Border],
        second: usize,
        sources: &mut Ragged<u8>,
    ) -> Result<()> {
        simulation.read_lanes(&self.lanes, &mut self.cars)?;
        let departures = simulation.departures()?;
        let departed: HashSet<CarId> = departures.iter().map(|departure| departure.id).collect();
        for (row, Border { plan, .. }) in plans.iter().enumerate() {
            let cars = CarsAt::new(&self.cars, self.first[row], plan.lanes.len());
            let BorderNow { present, counter, history } = &mut self.regions[row];
            let before = std::mem::take(present);
            for (number, lane) in cars.iter().enumerate() {
                for car in lane.iter().filter(|car| present.insert(car.id) && !before.contains(&car.id)) {
                    let border_lane = &plan.lanes[number];
                    let departed = departed.contains(&car.id);
                    let entry = border_lane.departures.filter(|_| departed).or(border_lane.entry);
                    entry.iter().for_each(|&entry| counter.arrived(entry));
                }
            }
            for (exit, &lane) in plan.exits.iter().enumerate() {
                if is_blocked(cars.lane(lane), plan.lanes[lane].length_m) {
                    counter.blocked(exit);
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

    /// Writes the d-set of a region after the last second of a decision.
    pub fn d_separate(&self, row: usize, border: &Border, light: LightView, d_set: &mut [f32]) {
        let cars = CarsAt::new(&self.cars, self.first[row], border.plan.lanes.len());
        border.d_set.write(&border.plan, cars, light, &self.regions[row].history, d_set);
    }
}
