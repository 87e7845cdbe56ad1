//! The entries of one local region: cars that were drawn for arrivals, and wait at the border until there is room.

use std::collections::{BTreeSet, VecDeque};

use super::visit_tables::VisitTables;
use super::visits::Visit;
use super::ways::Ways;
use crate::agents::border_plan::{BorderPlan, EntryPlace};
use dials_core::base::Dice;
use libsumo::DepartSpeed;

/// Position at which a car departs of which nothing is known, in metres.
const SOMEWHERE_M: f64 = 5.0;

/// The least distance between a car that departs and the end of its lane, in metres. At the very end SUMO lets
/// cars in although others stand there (seen on lanes of 1.8 m).
const BEFORE_END_M: f64 = 0.01;

/// A car that comes into the region.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Comer {
    /// Lane on which it begins, an index into [`BorderPlan::lanes`].
    pub(crate) lane: usize,
    pub(crate) position_m: f64,
    pub(crate) speed: DepartSpeed,
    /// Number of its route in [`Ways`].
    pub(crate) way: usize,
    /// Its vehicle type. `None`: the usual one.
    pub(crate) vehicle_type: Option<String>,
    pub(crate) speed_factor: f64,
    /// Whether it has found no room before.
    waited: bool,
}

/// The cars that wait at the entries of one region.
#[derive(Clone, Debug)]
pub(crate) struct Entrance {
    /// Cars by entry, the first one at the front.
    queues: Vec<VecDeque<Comer>>,
}

impl Entrance {
    /// Begins an episode: nobody waits.
    pub(crate) fn new(plan: &BorderPlan) -> Entrance {
        Entrance { queues: vec![VecDeque::new(); plan.entries.len()] }
    }

    /// Adds a car at the end of the queue of an entry.
    pub(crate) fn add(&mut self, entry: usize, comer: Comer) {
        self.queues[entry].push_back(comer);
    }

    /// Returns the number of cars that wait.
    pub(crate) fn waiting(&self) -> usize {
        self.queues.iter().map(VecDeque::len).sum()
    }

    /// Returns the cars that try to enter in this second, with their entries: the first one of each entry, and at most
    /// one per lane. Two cars on a lane would depend on SUMO's order.
    pub(crate) fn next(&self) -> impl Iterator<Item = (usize, &Comer)> {
        let mut taken = BTreeSet::new();
        let first = self.queues.iter().enumerate().filter_map(|(entry, queue)| Some((entry, queue.front()?)));
        first.filter(move |(_, comer)| taken.insert(comer.lane))
    }

    /// Notes that the first car of an entry has tried. If it is in, it leaves the queue. Returns whether it has found no
    /// room for the first time.
    pub(crate) fn tried(&mut self, entry: usize, is_in: bool) -> bool {
        if is_in {
            self.queues[entry].pop_front();
            return false;
        }
        let comer = self.queues[entry].front_mut().expect("a car that tried is in the queue");
        !std::mem::replace(&mut comer.waited, true)
    }
}

/// Draws the car that arrives at an entry in a second of the episode: one that makes a recorded visit. If none fits, it is
/// one of which nothing is known. `None`: not even that one may use the entry.
pub(crate) fn draw(
    plan: &BorderPlan,
    ways: &Ways,
    tables: &VisitTables,
    [agent, entry, second]: [usize; 3],
    dice: &mut Dice,
) -> Option<Comer> {
    match tables.draw(agent, entry, second, dice) {
        Some(visit) => comer(plan, ways, entry, visit),
        None => unknown(plan, ways, entry, tables.usual_class()),
    }
}

/// Returns the car that comes by an entry and makes this visit. `None`: it may not use the lane of the entry.
///
/// It comes on the lane of the entry, as far behind the border as it drives in half a second, and as fast as it can. A
/// car that departs in the region does so as one in the recording did.
pub(crate) fn comer(plan: &BorderPlan, ways: &Ways, entry: usize, visit: &Visit) -> Option<Comer> {
    let lane = plan.lane_of_entry(entry, &visit.driver.vehicle_class)?;
    let (lane, position_m, speed) = match &plan.entries[entry].place {
        EntryPlace::Lane(_) => (lane, visit.speed_mps / 2.0, DepartSpeed::Max),
        EntryPlace::Road(road) if plan.is_on_road(visit.lane, road) => {
            (visit.lane, visit.position_m, speed_at_departure(visit))
        }
        // It was first seen behind this road.
        EntryPlace::Road(_) => (lane, SOMEWHERE_M, DepartSpeed::Max),
    };
    Some(Comer {
        lane,
        position_m: on_lane(plan, lane, position_m),
        speed,
        way: ways.number(&visit.way, visit.next_road.as_ref()),
        vehicle_type: Some(visit.driver.vehicle_type.clone()),
        speed_factor: visit.driver.speed_factor,
        waited: false,
    })
}

/// Returns a car of the usual type that comes by an entry. `None`: its class may not use the entry.
fn unknown(plan: &BorderPlan, ways: &Ways, entry: usize, class: &str) -> Option<Comer> {
    let lane = plan.lane_of_entry(entry, class)?;
    let position_m = match &plan.entries[entry].place {
        EntryPlace::Lane(_) => 0.0,
        EntryPlace::Road(_) => on_lane(plan, lane, SOMEWHERE_M),
    };
    Some(Comer {
        lane,
        position_m,
        speed: DepartSpeed::Max,
        way: ways.default_of(entry),
        vehicle_type: None,
        speed_factor: 1.0,
        waited: false,
    })
}

/// Returns the position on a lane that is nearest to this one, in metres.
fn on_lane(plan: &BorderPlan, lane: usize, position_m: f64) -> f64 {
    position_m.clamp(0.0, (plan.lanes[lane].length_m - BEFORE_END_M).max(0.0))
}

/// Returns the speed of a departure: none, or the largest that is safe. Most files of routes say one of the two.
fn speed_at_departure(visit: &Visit) -> DepartSpeed {
    if visit.speed_mps == 0.0 { DepartSpeed::Fixed(0.0) } else { DepartSpeed::Max }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Arc;

    use super::*;
    use crate::agents::derive::border::Seconds;
    use crate::agents::derive::overrides::Overrides;
    use crate::agents::derive::{Rules, derive};
    use crate::network::roads::example::{LIGHT_AT_U, roads};
    use crate::sim::visits::Driver;

    #[test]
    fn a_bicycle_that_came_by_a_track_beside_the_lane_of_its_entry_does_not_come_on_that_lane() {
        const LANE: &str = r#"<lane id="near_1" index="1""#;
        let no_bicycles = [(LANE, &*format!("{LANE} disallow=\"bicycle\""))];
        let roads = roads(&[&LIGHT_AT_U[..], &no_bicycles].concat());
        let derived = derive(&roads, &Rules::default(), &Overrides::default()).unwrap();
        let borders = derived.borders(&roads, &BTreeSet::new(), 150.0, Seconds { decision: 5, episode: 1800 });
        let driver = Driver { vehicle_class: "bicycle".to_owned(), ..Driver::default() };
        let visit = Visit {
            second: 0,
            left: None,
            entry: Some(1),
            departed: false,
            lane: 1,
            position_m: 1.0,
            speed_mps: 4.0,
            way: vec!["near".to_owned(), "out".to_owned()],
            next_road: None,
            driver: Arc::new(driver),
        };
        assert_eq!(borders[0].plan.entry_name(1), "near_1");
        assert_eq!(comer(&borders[0].plan, &Ways::default(), 1, &visit), None);
        assert_eq!(unknown(&borders[0].plan, &Ways::default(), 1, "bicycle"), None);
    }

    #[test]
    fn no_car_enters_at_the_very_end_of_a_lane() {
        let roads = roads(&LIGHT_AT_U[..]);
        let derived = derive(&roads, &Rules::default(), &Overrides::default()).unwrap();
        let borders = derived.borders(&roads, &BTreeSet::new(), 150.0, Seconds { decision: 5, episode: 1800 });
        let mut plan = borders[0].plan.clone();
        plan.lanes[0].length_m = 1.8;
        assert_eq!([-1.0, 0.5, 1.8, 7.0].map(|position_m| on_lane(&plan, 0, position_m)), [0.0, 0.5, 1.79, 1.79]);
        plan.lanes[0].length_m = 0.005;
        assert_eq!(on_lane(&plan, 0, 7.0), 0.0);
    }
}
