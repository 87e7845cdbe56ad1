//! The car that comes for an arrival: at an edge of a grid by a rule, at an entry of a scenario as in a recorded visit.

use super::local_routes::LocalRoutes;
use super::visit_tables::VisitTables;
use super::visits::{Driver, Visit};
use crate::agents::border_plan::{BorderPlan, EntryPlace};
use crate::agents::others_plan::PUBLIC;
use crate::config::EntryRule;
use dials_core::base::Dice;
use libsumo::DepartSpeed;

/// Position at which a car departs of which nothing is known, in metres.
const SOMEWHERE_M: f64 = 5.0;

/// The least distance between a car that departs and the end of its lane, in metres. At the very end SUMO lets
/// cars in although others stand there (seen on lanes of 1.8 m).
const BEFORE_END_M: f64 = 0.01;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    pub position_m: f64,
    pub speed: DepartSpeed,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ArrivingCar {
    /// Lane on which it begins: an index into [`BorderPlan::lanes`], or the number of an edge of a grid.
    pub(crate) lane: usize,
    pub(crate) placement: Placement,
    pub(crate) route: usize,
    /// Its vehicle type. `None`: the usual one.
    pub(crate) vehicle_type: Option<String>,
    pub(crate) speed_factor: f64,
    /// Whether it is a bus, or another vehicle that carries many persons.
    pub(crate) is_bus: bool,
}

impl ArrivingCar {
    pub(super) fn on_edge(edge: usize, placement: Placement) -> ArrivingCar {
        ArrivingCar { lane: edge, placement, route: edge, vehicle_type: None, speed_factor: 1.0, is_bus: false }
    }

    /// Draws the car that arrives at an entry in a second of the episode: one that makes a recorded visit. If none fits,
    /// it is one of which nothing is known. `None`: not even that one may use the entry.
    pub(super) fn draw(
        plan: &BorderPlan,
        routes: &LocalRoutes,
        tables: &VisitTables,
        [agent, entry, second]: [usize; 3],
        dice: &mut Dice,
    ) -> Option<ArrivingCar> {
        match tables.draw(agent, entry, second, dice) {
            Some(visit) => ArrivingCar::of(plan, routes, entry, visit, tables.visits().driver(visit)),
            None => ArrivingCar::unknown(plan, routes, entry, tables.usual().1),
        }
    }

    /// Returns the car that comes by an entry and makes this visit. `None`: it may not use the lane of the entry.
    ///
    /// It comes on the lane of the entry, as far behind the border as it drives in half a second, and as fast as it can.
    /// A car that departs in the region does so as one in the recording did.
    pub(crate) fn of(
        plan: &BorderPlan,
        routes: &LocalRoutes,
        entry: usize,
        visit: &Visit,
        driver: &Driver,
    ) -> Option<ArrivingCar> {
        let lane = plan.lane_of_entry(entry, &driver.vehicle_class)?;
        let (lane, position_m, speed) = match &plan.entries[entry].place {
            EntryPlace::Lane(_) => (lane, visit.speed_mps / 2.0, DepartSpeed::Max),
            EntryPlace::Road(road) if plan.is_on_road(visit.lane, road) => {
                // Most files of routes ask for no speed, or for the largest that is safe.
                let speed = if visit.speed_mps == 0.0 { DepartSpeed::Fixed(0.0) } else { DepartSpeed::Max };
                (visit.lane, visit.position_m, speed)
            }
            // It was first seen behind this road.
            EntryPlace::Road(_) => (lane, SOMEWHERE_M, DepartSpeed::Max),
        };
        Some(ArrivingCar {
            lane,
            placement: Placement { position_m: on_lane(plan, lane, position_m), speed },
            route: routes.number(visit),
            vehicle_type: Some(driver.vehicle_type.clone()),
            speed_factor: driver.speed_factor,
            is_bus: PUBLIC.contains(&&*driver.vehicle_class),
        })
    }

    /// Returns a car of the usual type that comes by an entry. `None`: its class may not use the entry.
    fn unknown(plan: &BorderPlan, routes: &LocalRoutes, entry: usize, class: &str) -> Option<ArrivingCar> {
        let lane = plan.lane_of_entry(entry, class)?;
        let position_m = match &plan.entries[entry].place {
            EntryPlace::Lane(_) => 0.0,
            EntryPlace::Road(_) => on_lane(plan, lane, SOMEWHERE_M),
        };
        let placement = Placement { position_m, speed: DepartSpeed::Max };
        Some(ArrivingCar {
            lane,
            placement,
            route: routes.defaults[entry],
            vehicle_type: None,
            speed_factor: 1.0,
            is_bus: false,
        })
    }
}

/// Returns where a car is put on an edge of a grid on which `cars` were at the last decision.
pub(super) fn by_rule(rule: EntryRule, cars: usize) -> Placement {
    match rule {
        // The authors' rule.
        EntryRule::Reference => {
            let speed = if cars > 8 { 3.0 } else { 9.5 };
            Placement { position_m: 6.0, speed: DepartSpeed::Fixed(speed) }
        }
        // DEVIATION 10: the car enters as far back and as fast as it can. The authors' rule drops one car in nine,
        // because a fixed speed is often unsafe behind a car that has just entered.
        EntryRule::Max => Placement { position_m: 5.0, speed: DepartSpeed::Max },
    }
}

fn on_lane(plan: &BorderPlan, lane: usize, position_m: f64) -> f64 {
    position_m.clamp(0.0, (plan.lanes[lane].length_m - BEFORE_END_M).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::d_set::tests::border_of;

    #[test]
    fn no_car_enters_at_the_very_end_of_a_lane() {
        let mut plan = border_of(&[]).plan;
        plan.lanes[0].length_m = 1.8;
        assert_eq!([-1.0, 0.5, 1.8, 7.0].map(|position_m| on_lane(&plan, 0, position_m)), [0.0, 0.5, 1.79, 1.79]);
        plan.lanes[0].length_m = 0.005;
        assert_eq!(on_lane(&plan, 0, 7.0), 0.0);
    }
}
