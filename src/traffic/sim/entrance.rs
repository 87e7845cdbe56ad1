//! The entries of one local region: cars that were drawn for arrivals, and wait at the border until there is room.

use std::collections::{BTreeSet, VecDeque};

use super::visit_tables::VisitTables;
use super::visits::Visit;
use super::ways::Ways;
use crate::base::Dice;
use crate::sumo::DepartSpeed;
use crate::traffic::agents::border_plan::{BorderPlan, EntryPlace};

/// Position at which a car departs of which nothing is known, in metres.
const SOMEWHERE_M: f64 = 5.0;

/// A car that comes into the region.
#[derive(Clone, Debug, PartialEq)]
pub struct Comer {
    /// Lane on which it begins, an index into [`BorderPlan::lanes`].
    pub lane: usize,
    pub position_m: f64,
    pub speed: DepartSpeed,
    /// Number of its route in [`Ways`].
    pub way: usize,
    /// Its vehicle type. `None`: the usual one.
    pub vehicle_type: Option<String>,
    pub speed_factor: f64,
    /// Whether it has found no room before.
    waited: bool,
}

/// The cars that wait at the entries of one region.
#[derive(Clone, Debug)]
pub struct Entrance {
    /// Cars by entry, the first one at the front.
    queues: Vec<VecDeque<Comer>>,
}

impl Entrance {
    /// Begins an episode: nobody waits.
    pub fn new(plan: &BorderPlan) -> Entrance {
        Entrance { queues: vec![VecDeque::new(); plan.entries.len()] }
    }

    /// Adds a car at the end of the queue of an entry.
    pub fn add(&mut self, entry: usize, comer: Comer) {
        self.queues[entry].push_back(comer);
    }

    /// Returns the number of cars that wait.
    pub fn waiting(&self) -> usize {
        self.queues.iter().map(VecDeque::len).sum()
    }

    /// Returns the cars that try to enter in this second, with their entries: the first one of each entry, and at most
    /// one per lane. Two cars on a lane would depend on SUMO's order.
    pub fn next(&self) -> impl Iterator<Item = (usize, &Comer)> {
        let mut taken = BTreeSet::new();
        let first = self.queues.iter().enumerate().filter_map(|(entry, queue)| Some((entry, queue.front()?)));
        first.filter(move |(_, comer)| taken.insert(comer.lane))
    }

    /// Notes that the first car of an entry has tried. If it is in, it leaves the queue. Returns whether it has found no
    /// room for the first time.
    pub fn tried(&mut self, entry: usize, is_in: bool) -> bool {
        if is_in {
            self.queues[entry].pop_front();
            return false;
        }
        let comer = self.queues[entry].front_mut().expect("a car that tried is in the queue");
        !std::mem::replace(&mut comer.waited, true)
    }
}

/// Draws the car that arrives at an entry in a second of the episode: one that makes a recorded visit.
pub fn draw(
    plan: &BorderPlan,
    ways: &Ways,
    tables: &VisitTables,
    [agent, entry, second]: [usize; 3],
    dice: &mut Dice,
) -> Comer {
    comer(plan, ways, entry, tables.draw(agent, entry, second, dice))
}

/// Returns the car that comes by an entry and makes this visit. `None`: nothing is known of it.
///
/// It comes on the lane of the entry, as far behind the border as it drives in half a second, and as fast as it can. A
/// car that departs in the region does so as one in the recording did.
pub fn comer(plan: &BorderPlan, ways: &Ways, entry: usize, visit: Option<&Visit>) -> Comer {
    let way = visit.map_or(ways.default_of(entry), |visit| ways.number(&visit.way, visit.next_road.as_ref()));
    let (lane, position_m, speed) = match (&plan.entries[entry].place, visit) {
        (EntryPlace::Lane(lane), visit) => (*lane, visit.map_or(0.0, |visit| visit.speed_mps / 2.0), DepartSpeed::Max),
        (EntryPlace::Road(_), Some(visit)) => (visit.lane, visit.position_m, speed_at_departure(visit)),
        (EntryPlace::Road(road), None) => (first_lane(plan, road), SOMEWHERE_M, DepartSpeed::Max),
    };
    Comer {
        lane,
        position_m: position_m.clamp(0.0, plan.lanes[lane].length_m),
        speed,
        way,
        vehicle_type: visit.map(|visit| visit.driver.vehicle_type.clone()),
        speed_factor: visit.map_or(1.0, |visit| visit.driver.speed_factor),
        waited: false,
    }
}

/// Returns the speed of a departure: none, or the largest that is safe. Most files of routes say one of the two.
fn speed_at_departure(visit: &Visit) -> DepartSpeed {
    if visit.speed_mps == 0.0 { DepartSpeed::Fixed(0.0) } else { DepartSpeed::Max }
}

fn first_lane(plan: &BorderPlan, road: &str) -> usize {
    let of_road = |place: usize| plan.lanes[place].road.is_some_and(|number| plan.roads[number].road == road);
    (0..plan.lanes.len()).find(|&place| of_road(place)).expect("cars depart on roads with lanes for cars")
}
