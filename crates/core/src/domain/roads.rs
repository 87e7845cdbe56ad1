//! What is on the roads of all rows of a simulator: for rewards and observations that a user defines.
//!
//! [`RoadTables`] do not change. [`RoadsNow`] changes at every step. It has one array per property, and a row of these
//! arrays is a car or a lane. So a function over all of them at once costs little, whatever language it is written in.

use serde::Serialize;

/// The roads of all agents of a domain, as they always are.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RoadTables {
    /// One per agent.
    pub agents: Vec<AgentRoads>,
    /// Vehicle types. A type that is not listed has the number after the last one.
    pub types: Vec<VehicleType>,
    /// Ways from one light to the next one, without a third one between them.
    pub adjacency: Vec<Adjacent>,
}

/// The roads of one light.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AgentRoads {
    pub name: String,
    /// Place of the intersection in the coordinates of the net, in metres.
    pub place_m: [f64; 2],
    /// Number of greens.
    pub greens: usize,
    /// Lanes to the stop lines, in the order of observations.
    pub approaches: Vec<RoadLane>,
    /// Lanes on which vehicles leave the light.
    pub exits: Vec<RoadLane>,
    /// Names of the detectors, if the agents see detectors.
    pub detectors: Vec<String>,
}

/// A lane on which vehicles come to a light or leave it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RoadLane {
    /// Name of the lane.
    pub lane: String,
    pub length_m: f64,
    pub limit_mps: f64,
    /// Distance from the end of an approach to the stop line. An exit has 0.
    pub ahead_m: f64,
    /// Agent that feeds an approach, or is fed by an exit: the nearest one.
    pub neighbour: Option<usize>,
    /// Greens that let vehicles of an approach go. An exit has none.
    pub greens: Vec<usize>,
}

/// A type of vehicles.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VehicleType {
    pub name: String,
    /// SUMO's class, such as `passenger` or `bus`.
    pub class: String,
}

/// The shortest way from the exits of one light to a stop line of the next one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Adjacent {
    /// Agents.
    pub from: usize,
    pub to: usize,
    /// Length of the way, and the time that it takes at the speed limits.
    pub metres: f64,
    pub seconds: f64,
}

/// What is on the roads now. `rows`: one per agent on the GS, one per agent and copy in an LS.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoadsNow {
    /// Index of the green that is shown, or that comes next, `[rows]`.
    pub green: Vec<u32>,
    /// 1 while a light is on its way to its next green: yellow, red for all, or the end of the walk on crossings, `[rows]`.
    pub between: Vec<u32>,
    /// Number of seconds for which the light has shown what it shows, `[rows]`.
    pub shown_s: Vec<f32>,
    /// Number of persons who wait at the light's crossings, `[rows]`. An LS has none.
    pub persons: Vec<f32>,
    /// What the detectors have seen, three numbers for each detector of each row.
    pub detectors: Vec<f32>,
    /// Number of vehicles on each approach of each row, and on each exit.
    pub on_approach: Vec<u32>,
    pub on_exit: Vec<u32>,
    /// Vehicles on the approaches, lane by lane, the rearmost first. The same for those on the exits.
    pub coming: VehiclesNow,
    pub leaving: VehiclesNow,
}

/// Vehicles, one entry each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VehiclesNow {
    /// Distance of its front from the beginning of the lane.
    pub position_m: Vec<f32>,
    pub speed_mps: Vec<f32>,
    /// Number of seconds for which it has stood on the approaches of this light. On exits 0.
    pub waited_s: Vec<f32>,
    /// Number of its type in [`RoadTables::types`].
    pub kind: Vec<u32>,
    /// Exit on which it will leave this light: an index into the exits of the agent. [`NO_EXIT`]: not known, or it ends
    /// before. On exits all are [`NO_EXIT`].
    pub exit: Vec<u32>,
}

/// Exit of a vehicle of which it is not known.
pub const NO_EXIT: u32 = u32::MAX;

impl VehiclesNow {
    pub fn len(&self) -> usize {
        self.position_m.len()
    }

    pub fn is_empty(&self) -> bool {
        self.position_m.is_empty()
    }

    fn clear(&mut self) {
        let VehiclesNow { position_m, speed_mps, waited_s, kind, exit } = self;
        [position_m, speed_mps, waited_s].into_iter().for_each(Vec::clear);
        [kind, exit].into_iter().for_each(Vec::clear);
    }

    fn put(&self, bytes: &mut Vec<u8>) {
        let VehiclesNow { position_m, speed_mps, waited_s, kind, exit } = self;
        for numbers in [position_m, speed_mps, waited_s] {
            bytes.extend_from_slice(bytemuck::cast_slice(numbers));
        }
        for numbers in [kind, exit] {
            bytes.extend_from_slice(bytemuck::cast_slice(numbers));
        }
    }
}

impl RoadsNow {
    /// Forgets all rows, and keeps the memory.
    pub fn clear(&mut self) {
        let RoadsNow { green, between, shown_s, persons, detectors, on_approach, on_exit, coming, leaving } = self;
        [green, between, on_approach, on_exit].into_iter().for_each(Vec::clear);
        [shown_s, persons, detectors].into_iter().for_each(Vec::clear);
        [coming, leaving].into_iter().for_each(VehiclesNow::clear);
    }

    /// Adds all numbers to `bytes`, four bytes each, array after array in the order of the fields. Python's `roads.py`
    /// reads them.
    pub fn put(&self, bytes: &mut Vec<u8>) {
        let RoadsNow { green, between, shown_s, persons, detectors, on_approach, on_exit, coming, leaving } = self;
        for numbers in [green, between] {
            bytes.extend_from_slice(bytemuck::cast_slice(numbers));
        }
        for numbers in [shown_s, persons, detectors] {
            bytes.extend_from_slice(bytemuck::cast_slice(numbers));
        }
        for numbers in [on_approach, on_exit] {
            bytes.extend_from_slice(bytemuck::cast_slice(numbers));
        }
        coming.put(bytes);
        leaving.put(bytes);
    }
}
