//! All visits of cars to the regions of a scenario in one episode on the GS (global simulator): when and where each car
//! came in, and where it went.

use std::collections::HashMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::sumo::{Car, CarId, Departure};
use crate::traffic::agents::border_plan::{BorderPlan, EntryPlace};

/// The visits of one episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Visits {
    /// Visits to the region of each agent, in the order of arrival.
    pub of_agents: Vec<Vec<Visit>>,
    /// Number of seconds that were observed.
    pub seconds: usize,
}

/// A stay of a car on a region, from its arrival on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Visit {
    /// Second of the episode after which the car was first seen; the first one is 0.
    pub second: usize,
    /// Second after which it was no longer there. `None`: it is there at the end of the episode.
    pub left: Option<usize>,
    /// Index into [`BorderPlan::entries`]. `None`: SUMO moved it here, or it came in too far from any entry.
    pub entry: Option<usize>,
    /// Whether it departed on the region in that second. Then lane, position and speed are those of its departure.
    pub departed: bool,
    /// Lane on which it was first seen, an index into [`BorderPlan::lanes`], with position and speed there.
    pub lane: usize,
    pub position_m: f64,
    pub speed_mps: f64,
    /// Roads of the region that it comes by, in order. Empty: its route is not known.
    pub way: Vec<String>,
    /// Road behind the region. `None`: its trip ends here.
    pub next_road: Option<String>,
    /// Many visits have the same one: see [`super::visits_as_bytes`].
    #[serde(skip)]
    pub driver: Arc<Driver>,
}

/// What is known of a car since it departed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Driver {
    /// SUMO's name.
    pub name: String,
    pub vehicle_type: String,
    /// Desired speed as a share of the limit.
    pub speed_factor: f64,
    /// Roads of its route.
    pub route: Vec<String>,
}

/// Writes the visits down, second by second.
pub struct VisitRecorder {
    visits: Visits,
    drivers: HashMap<CarId, Arc<Driver>>,
    /// Visits under way, by agent: the place in the list.
    open: Vec<HashMap<CarId, usize>>,
    /// Number of roads of a route that a car has behind it after its last visit, by agent.
    behind: Vec<HashMap<CarId, usize>>,
}

impl VisitRecorder {
    pub fn new(agents: usize) -> VisitRecorder {
        VisitRecorder {
            visits: Visits { of_agents: vec![Vec::new(); agents], seconds: 0 },
            drivers: HashMap::new(),
            open: vec![HashMap::new(); agents],
            behind: vec![HashMap::new(); agents],
        }
    }

    pub fn visits(&self) -> &Visits {
        &self.visits
    }

    /// Begins an episode.
    pub fn begin(&mut self) {
        *self = VisitRecorder::new(self.open.len());
    }

    /// Begins a second, in which these cars departed.
    pub fn second(&mut self, departures: &[Departure]) {
        self.visits.seconds += 1;
        for Departure { id, name, vehicle_type, edges, speed_factor, .. } in departures {
            let driver = Driver {
                name: name.clone(),
                vehicle_type: vehicle_type.clone(),
                speed_factor: *speed_factor,
                route: edges.clone(),
            };
            self.drivers.insert(*id, Arc::new(driver));
        }
    }

    /// Notes a car that came on a region in this second. `lane`: index into the lanes of the border.
    pub fn arrived(
        &mut self,
        agent: usize,
        plan: &BorderPlan,
        car: Car,
        lane: usize,
        entry: Option<usize>,
        departed: bool,
    ) {
        // Cars that were on the road before the episode began have no driver.
        let Some(driver) = self.drivers.get(&car.id).cloned() else { return };
        let behind = self.behind[agent].get(&car.id).copied().unwrap_or(0);
        let from = entry.map(|entry| match &plan.entries[entry].place {
            EntryPlace::Lane(lane) => road_of(&plan.lanes[*lane].lane),
            EntryPlace::Road(road) => road,
        });
        let ahead = &driver.route[behind..];
        let at = |road: &str| ahead.iter().position(|other| other == road);
        let within = |road: &String| plan.roads.iter().find(|other| other.road == *road);
        let begin = from.and_then(at).or_else(|| ahead.iter().position(|road| within(road).is_some()));
        let begin = begin.unwrap_or(ahead.len());
        let mut end = begin;
        while let Some(road) = ahead.get(end).and_then(within) {
            end += 1;
            if road.ends_outside {
                break;
            }
        }
        let visit = Visit {
            second: self.visits.seconds - 1,
            left: None,
            entry,
            departed,
            lane,
            position_m: car.position_m,
            speed_mps: car.speed_mps,
            way: ahead[begin..end].to_vec(),
            next_road: ahead.get(end).cloned(),
            driver,
        };
        self.behind[agent].insert(car.id, behind + end);
        self.open[agent].insert(car.id, self.visits.of_agents[agent].len());
        self.visits.of_agents[agent].push(visit);
    }

    /// Notes a car that has left a region in this second, if it was there.
    pub fn left(&mut self, agent: usize, car: CarId) {
        if let Some(visit) = self.open[agent].remove(&car) {
            self.visits.of_agents[agent][visit].left = Some(self.visits.seconds - 1);
        }
    }
}

/// Returns the name of the road of a lane: SUMO adds `_` and the number of the lane.
fn road_of(lane: &str) -> &str {
    lane.rsplit_once('_').map_or(lane, |(road, _)| road)
}
