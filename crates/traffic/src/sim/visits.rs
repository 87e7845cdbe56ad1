//! All visits of cars to the regions of a scenario in one episode on the GS: when and where each car came in, and
//! where it went.

use std::collections::HashMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::agents::border_plan::BorderPlan;
use crate::cut::beyond::Reach;
use crate::scenario::stops::{Stop, Stops};
use libsumo::{Car, CarId, Departure, RouteNow};

/// Ends of trips are rounded up to multiples of this, in metres.
const END_STEP_M: f64 = 5.0;

/// Number of roads behind a region that a visit knows.
const MOST_BEHIND: usize = Reach::USUAL_HOPS;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Visits {
    /// Visits to the region of each agent, in the order of arrival.
    pub of_agents: Vec<Vec<Visit>>,
    /// Cars that departed. Most visit several regions.
    pub(crate) drivers: Vec<Driver>,
    pub seconds: usize,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Visit {
    /// Second of the episode after which the car was first seen; the first one is 0.
    pub second: usize,
    /// Index into [`BorderPlan::entries`]. `None`: SUMO moved it here, or it came in too far from any entry, or by another
    /// road than that of the nearest one.
    pub entry: Option<usize>,
    /// Lane on which it was first seen, an index into [`BorderPlan::lanes`], with position and speed there. If it departed on
    /// the region, they are those of its departure.
    pub lane: usize,
    pub position_m: f64,
    pub speed_mps: f64,
    /// Roads of the region that it comes by, in order, as it means to when it is first seen. Empty: SUMO has moved it, and
    /// an earlier visit has its way.
    pub way: Vec<String>,
    /// The next roads behind the region, the nearest first. Empty: its trip ends here.
    pub next_roads: Vec<String>,
    /// Position on its last road at which its trip ends, in metres, in steps of [`END_STEP_M`]. `None`: at the road's end, or
    /// elsewhere.
    pub end_m: Option<u32>,
    /// Stops on its way through the region.
    pub(crate) stops: Vec<Stop>,
    pub driver: usize,
}

impl Visits {
    pub(crate) fn all(&self) -> impl Iterator<Item = &Visit> {
        self.of_agents.iter().flatten()
    }

    pub fn driver(&self, visit: &Visit) -> &Driver {
        &self.drivers[visit.driver]
    }

    /// Adds the visits of another episode of the same length, behind those that are there.
    pub(crate) fn extend(&mut self, other: Visits) {
        let before = self.drivers.len();
        self.drivers.extend(other.drivers);
        for (of_agent, others) in self.of_agents.iter_mut().zip(other.of_agents) {
            of_agent.extend(others.into_iter().map(|visit| Visit { driver: visit.driver + before, ..visit }));
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Driver {
    pub name: String,
    pub(crate) vehicle_type: String,
    pub(crate) vehicle_class: String,
    /// Desired speed as a share of the limit.
    pub(crate) speed_factor: f64,
}

pub(crate) struct Arrival {
    pub(crate) car: Car,
    /// Index into [`BorderPlan::lanes`].
    pub(crate) lane: usize,
    /// The nearest entry, as in [`Visit::entry`].
    pub(crate) entry: Option<usize>,
    pub(crate) departed: bool,
    pub(crate) route: RouteNow,
}

pub(crate) struct VisitRecorder {
    pub(super) visits: Visits,
    /// Indices into [`Visits::drivers`].
    drivers: HashMap<CarId, usize>,
    /// Index of the road of a car's route at which its last visit began, by agent. SUMO never changes the part of a route
    /// that is behind a car.
    began: Vec<HashMap<CarId, usize>>,
    /// Index of the last visit of a car, by agent.
    latest: Vec<HashMap<CarId, usize>>,
    pub(super) stops: Arc<Stops>,
}

impl VisitRecorder {
    pub(crate) fn new(agents: usize, stops: Arc<Stops>) -> VisitRecorder {
        VisitRecorder {
            visits: Visits { of_agents: vec![Vec::new(); agents], ..Visits::default() },
            drivers: HashMap::new(),
            began: vec![HashMap::new(); agents],
            latest: vec![HashMap::new(); agents],
            stops,
        }
    }

    pub(crate) fn second(&mut self, departures: &[Departure]) {
        self.visits.seconds += 1;
        for Departure { id, name, vehicle_type, vehicle_class, speed_factor, .. } in departures {
            self.drivers.insert(*id, self.visits.drivers.len());
            self.visits.drivers.push(Driver {
                name: name.clone(),
                vehicle_type: vehicle_type.clone(),
                vehicle_class: vehicle_class.clone(),
                speed_factor: *speed_factor,
            });
        }
    }

    /// Returns the name of a car. `None`: it was on the road before the episode began.
    pub(crate) fn name_of(&self, car: CarId) -> Option<&str> {
        self.drivers.get(&car).map(|&driver| &*self.visits.drivers[driver].name)
    }

    pub(crate) fn arrived(&mut self, agent: usize, plan: &BorderPlan, arrival: Arrival) {
        let Arrival { car, lane, entry, departed, route: RouteNow { edges, at } } = arrival;
        let Some(&driver) = self.drivers.get(&car.id) else { return };
        let within = |road: &String| plan.roads.iter().find(|other| other.road == *road);
        // It may have crossed roads of the region before it was seen.
        let mut begin = at;
        while begin > 0 && !departed && within(&edges[begin]).is_some_and(|road| !road.begins_outside) {
            begin -= 1;
        }
        let is_moved = self.began[agent].insert(car.id, begin) == Some(begin);
        let mut end = begin;
        while let Some(road) = edges.get(end).and_then(within) {
            end += 1;
            if road.ends_outside {
                break;
            }
        }
        let visit = Visit {
            second: self.visits.seconds - 1,
            // A car enters a local simulator on the first road of its way. So that must be the road of its entry.
            entry: entry.filter(|&entry| plan.road_of_entry(entry) == edges[begin]),
            lane,
            position_m: car.position_m,
            speed_mps: car.speed_mps,
            way: if is_moved { Vec::new() } else { edges[begin..end].to_vec() },
            next_roads: edges[end..].iter().take(MOST_BEHIND).cloned().collect(),
            end_m: None,
            stops: Vec::new(),
            driver,
        };
        let on_way =
            |stop: &&Stop| stop.lane.rsplit_once('_').is_some_and(|(road, _)| visit.way.iter().any(|on| on == road));
        let stops = self.stops.of(&self.visits.drivers[driver].name).iter().filter(on_way).cloned().collect();
        let visit = Visit { stops, ..visit };
        self.latest[agent].insert(car.id, self.visits.of_agents[agent].len());
        self.visits.of_agents[agent].push(visit);
    }

    /// Notes that a car ended its trip on a road, about there.
    pub(crate) fn ended(&mut self, agent: usize, car: CarId, road: &str, position_m: f64) {
        let Some(&latest) = self.latest[agent].get(&car) else { return };
        let visit = &mut self.visits.of_agents[agent][latest];
        if visit.next_roads.is_empty() && visit.way.last().is_some_and(|last| last == road) {
            visit.end_m = Some(((position_m / END_STEP_M).ceil() * END_STEP_M) as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::d_set::tests::border_of;

    /// Returns entry, way and next road of each visit. `seen`: a lane in each second, the route, and how far on it.
    fn visits(departed_with: &[&str], seen: &[(&str, &[&str], usize)]) -> Vec<(Option<usize>, String, Option<String>)> {
        let plan = border_of(&[]).plan;
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let car = Car { id: CarId(1), position_m: 3.0, speed_mps: 9.0 };
        let departure = Departure {
            id: car.id,
            name: "1".to_owned(),
            vehicle_type: "car".to_owned(),
            vehicle_class: "passenger".to_owned(),
            route: String::new(),
            edges: names(departed_with),
            lane: 0,
            position_m: 0.0,
            speed_mps: 0.0,
            speed_factor: 1.0,
        };
        let mut recorder = VisitRecorder::new(1, Arc::default());
        recorder.second(&[departure]);
        for (lane, edges, at) in seen {
            recorder.second(&[]);
            let lane = plan.lanes.iter().position(|other| other.lane == *lane).unwrap();
            let route = RouteNow { edges: names(edges), at: *at };
            let entry = plan.lanes[lane].entry;
            recorder.arrived(0, &plan, Arrival { car, lane, entry, departed: false, route });
        }
        let visits = recorder.visits.of_agents[0].iter();
        visits.map(|visit| (visit.entry, visit.way.join(" "), visit.next_roads.first().cloned())).collect()
    }

    #[test]
    fn the_way_of_a_visit_is_the_one_that_the_car_means_to_go_when_it_comes() {
        for (departed_with, lane, route, at, entry, way, next_road) in [
            // It departed for `out`, and goes another way since.
            (
                &["far", "near", "out"][..],
                "near_1",
                &["far", "near", "back", "west"][..],
                1,
                Some(1),
                "near back",
                Some("west"),
            ),
            // The road of its entry was not on its first route at all.
            (&["side", "west"], "near_0", &["side", "near", "out"], 1, Some(0), "near out", None),
            // It crossed the road of its entry within a second.
            (&["far", "near", "out"], "out_0", &["far", "near", "out"], 2, Some(0), "near out", None),
            // The nearest entry to `out` is on `near`, but its way begins on another road.
            (&["north", "out"], "out_0", &["north", "out"], 1, None, "north out", None),
        ] {
            let seen = visits(departed_with, &[(lane, route, at)]);
            assert_eq!(seen, [(entry, way.to_owned(), next_road.map(str::to_owned))]);
        }
    }

    #[test]
    fn a_car_that_sumo_moves_within_the_region_makes_its_way_once_but_it_may_come_back() {
        let round = &["near", "back", "near", "out"][..];
        let seen = visits(round, &[("near_1", round, 0), ("back_0", round, 1), ("near_0", round, 2)]);
        let ways: Vec<&str> = seen.iter().map(|(_, way, _)| way.as_str()).collect();
        assert_eq!(ways, ["near back", "", "near out"]);
    }
}
