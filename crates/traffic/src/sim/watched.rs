//! All that is on the roads of the lights, for rewards and observations of the user's own.
//!
//! A vehicle's type and exit are looked up by its number. They are noted once, when it enters. A vehicle that takes another
//! way later keeps the exit of the way on which it departed.

use std::collections::HashMap;

use crate::agents::adjacency::Adjacency;
use crate::agents::phase_plan::Shown;
use crate::agents::plan::{AgentPlan, JointPlan};
use crate::cars_at::CarsAt;
use crate::network::roads::Roads;
use crate::reward::Waiting;
use crate::scenario::travellers::Travellers;
use crate::sim::readings::{COLUMNS, Readings};
use dials_core::domain::roads::{AgentRoads, NO_EXIT, RoadLane, RoadTables, RoadsNow, VehicleType, VehiclesNow};
use libsumo::{CarId, Departure, LaneCars};

/// The type of the cars of a grid.
const OF_A_GRID: (&str, &str) = ("car", "passenger");

/// Returns the roads of all agents. `travellers`: `None` on a grid.
pub(crate) fn tables(plan: &JointPlan, roads: &Roads, travellers: Option<&Travellers>) -> RoadTables {
    let Adjacency { ways, feeders, fed } = Adjacency::of(roads, &plan.agents);
    let agents = plan.agents.iter().zip(feeders.iter().zip(&fed)).map(|(agent, (feeders, fed))| {
        let approaches =
            agent.region.approaches.iter().zip(feeders).enumerate().map(|(number, (lane, &neighbour))| RoadLane {
                lane: lane.lane.clone(),
                length_m: lane.length_m,
                limit_mps: lane.speed_limit_mps,
                ahead_m: lane.ahead_m,
                neighbour,
                greens: (0..agent.greens()).filter(|&green| agent.serves(green, number)).collect(),
            });
        let exits = agent.region.exits.iter().zip(fed).map(|(lane, &neighbour)| RoadLane {
            lane: lane.lane.clone(),
            length_m: lane.length_m,
            limit_mps: lane.speed_limit_mps,
            ahead_m: 0.0,
            neighbour,
            greens: Vec::new(),
        });
        let detectors = if plan.sees_detectors() { agent.sensor.detectors() } else { &[] };
        let detectors = detectors.iter().map(|detector| detector.name(&agent.region.approaches)).collect();
        AgentRoads {
            name: agent.light.clone(),
            place_m: agent.place_m,
            greens: agent.greens(),
            approaches: approaches.collect(),
            exits: exits.collect(),
            detectors,
        }
    });
    let types = types(travellers).into_iter().map(|(name, class)| VehicleType { name, class });
    RoadTables { agents: agents.collect(), types: types.collect(), adjacency: ways }
}

/// Returns names and classes of all types, always in the same order.
fn types(travellers: Option<&Travellers>) -> Vec<(String, String)> {
    match travellers {
        None => vec![(OF_A_GRID.0.to_owned(), OF_A_GRID.1.to_owned())],
        Some(travellers) => travellers.class_of.clone().into_iter().collect(),
    }
}

/// What is known of vehicles since they entered.
#[derive(Debug, Default)]
pub(crate) struct Watched {
    /// Numbers of the types.
    kinds: HashMap<String, u32>,
    ways_out: Vec<WaysOut>,
    vehicles: HashMap<CarId, Vehicle>,
}

#[derive(Debug)]
struct Vehicle {
    kind: u32,
    /// Row in which it entered an LS.
    row: usize,
    /// Rows with the exits on which it leaves their lights.
    exits: Vec<(usize, u32)>,
}

/// The roads that lead to a light, and those that lead away from it, by name.
#[derive(Debug)]
struct WaysOut {
    comes_on: Vec<String>,
    /// Each with the number of its first exit.
    leaves_on: Vec<(String, u32)>,
}

impl WaysOut {
    fn of(agent: &AgentPlan) -> WaysOut {
        let comes_on = agent.region.approaches.iter().map(|lane| edge_of(&lane.lane).to_owned()).collect();
        let mut leaves_on: Vec<(String, u32)> = Vec::new();
        for (number, exit) in agent.region.exits.iter().enumerate() {
            let edge = edge_of(&exit.lane);
            if leaves_on.iter().all(|(other, _)| other != edge) {
                leaves_on.push((edge.to_owned(), number as u32));
            }
        }
        WaysOut { comes_on, leaves_on }
    }

    /// Returns the exit on which a route leaves the light, after it has come to it for the first time.
    fn exit_of(&self, edges: &[String]) -> Option<u32> {
        let comes = edges.iter().position(|edge| self.comes_on.contains(edge))?;
        edges[comes..].iter().find_map(|edge| Some(self.leaves_on.iter().find(|(other, _)| other == edge)?.1))
    }
}

/// Returns the edge of a lane, by SUMO's names.
fn edge_of(lane: &str) -> &str {
    lane.rsplit_once('_').map_or(lane, |(edge, _)| edge)
}

/// What a row shows beside the vehicles on its approaches and exits.
pub(crate) struct RowShows<'a> {
    pub(crate) shown: Shown,
    pub(crate) shown_s: u32,
    pub(crate) waiting: &'a Waiting,
    pub(crate) readings: Option<&'a Readings>,
    pub(crate) persons: u32,
}

impl Watched {
    pub(crate) fn new(plan: &JointPlan, travellers: Option<&Travellers>) -> Watched {
        let kinds = types(travellers).into_iter().map(|(name, _)| name).zip(0..);
        Watched {
            kinds: kinds.collect(),
            ways_out: plan.agents.iter().map(WaysOut::of).collect(),
            vehicles: HashMap::new(),
        }
    }

    /// Begins an episode of the GS.
    pub(crate) fn begin(&mut self) {
        self.vehicles.clear();
    }

    /// Begins an episode of a row of an LS.
    pub(crate) fn begin_row(&mut self, row: usize) {
        self.vehicles.retain(|_, vehicle| vehicle.row != row);
    }

    /// Notes the vehicles that entered the GS in the last second.
    pub(crate) fn entered(&mut self, departures: &[Departure]) {
        for departure in departures {
            let ways_out = self.ways_out.iter().enumerate();
            let exits = ways_out.filter_map(|(row, ways)| Some((row, ways.exit_of(&departure.edges)?)));
            let vehicle = Vehicle { kind: self.kind(Some(&departure.vehicle_type)), row: 0, exits: exits.collect() };
            self.vehicles.insert(departure.id, vehicle);
        }
    }

    /// Notes a vehicle that enters a row of an LS, which is of an agent. `kind`: the name of its type, or `None` for that of
    /// most vehicles; `edges`: its route, if it is known.
    pub(crate) fn enters(&mut self, car: CarId, [row, agent]: [usize; 2], kind: Option<&str>, edges: &[String]) {
        let exits = self.ways_out[agent].exit_of(edges).map(|exit| (row, exit)).into_iter().collect();
        self.vehicles.insert(car, Vehicle { kind: self.kind(kind), row, exits });
    }

    fn kind(&self, name: Option<&str>) -> u32 {
        let name = name.unwrap_or(if self.kinds.len() == 1 { OF_A_GRID.0 } else { "" });
        self.kinds.get(name).copied().unwrap_or(self.kinds.len() as u32)
    }

    /// Adds a row. `cars`: those on its approaches; `exits`: those on its exits.
    pub(crate) fn put_row(&self, row: usize, shows: &RowShows<'_>, [cars, exits]: [CarsAt<'_>; 2], now: &mut RoadsNow) {
        now.green.push(shows.shown.target() as u32);
        now.between.push(u32::from(!shows.shown.is_green()));
        now.shown_s.push(shows.shown_s as f32);
        now.persons.push(shows.persons as f32);
        if let Some(readings) = shows.readings {
            let begin = now.detectors.len();
            now.detectors.resize(begin + COLUMNS * readings.len(), 0.0);
            readings.write(&mut now.detectors[begin..]);
        }
        for lane in cars.iter() {
            now.on_approach.push(lane.len() as u32);
            self.put_lane(row, lane, Some(shows.waiting), &mut now.coming);
        }
        for lane in exits.iter() {
            now.on_exit.push(lane.len() as u32);
            self.put_lane(row, lane, None, &mut now.leaving);
        }
    }

    /// Adds the vehicles on a lane. `waiting`: on an approach.
    fn put_lane(&self, row: usize, lane: LaneCars<'_>, waiting: Option<&Waiting>, now: &mut VehiclesNow) {
        now.position_m.extend(lane.positions_m.iter().map(|&position| position as f32));
        now.speed_mps.extend(lane.speeds_mps.iter().map(|&speed| speed as f32));
        now.waited_s.extend(lane.ids.iter().map(|&car| waiting.map_or(0.0, |waiting| waiting.of(car) as f32)));
        for car in lane.ids {
            let vehicle = self.vehicles.get(car);
            now.kind.push(vehicle.map_or(self.kinds.len() as u32, |vehicle| vehicle.kind));
            let exits = vehicle.filter(|_| waiting.is_some()).map_or(&[][..], |vehicle| &vehicle.exits);
            let exit = exits.iter().find(|(other, _)| *other == row);
            now.exit.push(exit.map_or(NO_EXIT, |&(_, exit)| exit));
        }
    }
}
