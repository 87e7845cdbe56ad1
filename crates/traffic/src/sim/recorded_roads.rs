//! The roads of a recording: a grid of the paper, or a scenario of the user.

use std::collections::HashMap;

use anyhow::{Context, Result};

use crate::agents::plan::AgentPlan;
use crate::network::contents::Network;
use crate::network::roads::{Function, Roads};
use crate::network::tree::Element;
use crate::paper_grid::grid::{Grid, edge, lane};
use crate::scenario::SumoScenario;
use crate::sim::recorded_local::LocalFiles;

/// The roads of a recording.
#[derive(Clone, Debug)]
pub struct RecordedRoads {
    pub ground: RecordedGround,
    /// All lanes on which cars can be, with those inside of intersections.
    pub lanes: Vec<Lane>,
    /// Numbers of the lanes, by name.
    numbers: HashMap<String, usize>,
    /// Names of the lights: one per agent, then those that keep their program.
    pub lights: Vec<String>,
}

/// What a replay and pictures need to know of the place.
#[derive(Clone, Debug)]
pub enum RecordedGround {
    Grid(RecordedGrid),
    Scenario(Box<RecordedScenario>),
}

/// A grid. Its lanes are those of the edges in the order of [`Grid::edges`], then those inside of intersections.
#[derive(Clone, Debug)]
pub struct RecordedGrid {
    pub grid: Grid,
    /// Text of the net, as SUMO loaded it.
    pub net: String,
    pub vehicle_types: Vec<Element>,
}

/// A scenario, or the surroundings of one of its lights. Its lanes are in the order of the net.
#[derive(Clone, Debug)]
pub struct RecordedScenario {
    pub files: RecordedFiles,
    pub roads: Roads,
    /// Plans of the agents, in their order.
    pub agents: Vec<AgentPlan>,
}

/// The files of a recorded scenario.
#[derive(Clone, Debug)]
pub enum RecordedFiles {
    Whole(Box<SumoScenario>),
    /// Those of a local simulator.
    Local(Box<LocalFiles>),
}

#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    pub name: String,
    pub length_m: f64,
}

impl RecordedRoads {
    /// Returns the roads of a grid with its network.
    pub fn of_grid(grid: Grid, network: &Network) -> Result<RecordedRoads> {
        let place = network.files.net.display();
        let root = &network.net.root;
        let lengths: HashMap<&str, f64> = root
            .all("edge")
            .flat_map(|edge| edge.all("lane"))
            .filter_map(|lane| Some((lane.attribute("id")?, lane.attribute("length")?.parse().ok()?)))
            .collect();
        let length =
            |name: &str| lengths.get(name).copied().with_context(|| format!("{place}: no lane `{name}` with a length"));
        let edges = grid.edges().into_iter().map(|(from, to)| lane(&edge(from, to)));
        let internal = grid.agents().into_iter().flat_map(|agent| grid.internal_lanes(agent));
        let lanes = edges.chain(internal).map(|name| Ok(Lane { length_m: length(&name)?, name }));
        let lanes = lanes.collect::<Result<Vec<Lane>>>()?;
        let children = network.routes.root.children.iter();
        let vehicle_types = children.filter(|child| child.name.starts_with("vType")).cloned().collect();
        let lights = grid.agents().into_iter().map(|agent| grid.light(agent)).collect();
        let ground = RecordedGround::Grid(RecordedGrid { grid, net: network.net.text(), vehicle_types });
        Ok(RecordedRoads::new(ground, lanes, lights))
    }

    /// Returns the roads of a scenario with these agents.
    pub fn of_scenario(files: &SumoScenario, agents: Vec<AgentPlan>) -> Result<RecordedRoads> {
        let roads = files.roads()?;
        let mut lights: Vec<String> = agents.iter().map(|agent| agent.light.clone()).collect();
        for program in &roads.programs {
            // SUMO has no light that controls nothing.
            if !lights.contains(&program.light) && roads.of_light(&program.light).next().is_some() {
                lights.push(program.light.clone());
            }
        }
        Ok(RecordedRoads::of_lights(RecordedFiles::Whole(Box::new(files.clone())), roads, agents, lights))
    }

    /// Returns the roads of a scenario with these lights, those of the agents first.
    pub(super) fn of_lights(
        files: RecordedFiles,
        roads: Roads,
        agents: Vec<AgentPlan>,
        lights: Vec<String>,
    ) -> RecordedRoads {
        let drivable = |function| matches!(function, Function::Road | Function::Internal);
        let lanes = roads.lanes.iter().filter(|lane| drivable(roads.edge(lane.edge).function));
        let lanes = lanes.map(|lane| Lane { name: lane.id.clone(), length_m: lane.length_m }).collect();
        RecordedRoads::new(RecordedGround::Scenario(Box::new(RecordedScenario { files, roads, agents })), lanes, lights)
    }

    fn new(ground: RecordedGround, lanes: Vec<Lane>, lights: Vec<String>) -> RecordedRoads {
        let numbers = lanes.iter().enumerate().map(|(number, lane)| (lane.name.clone(), number)).collect();
        RecordedRoads { ground, lanes, numbers, lights }
    }

    /// Returns the second at which an episode begins.
    pub fn begin_s(&self) -> u64 {
        match &self.ground {
            RecordedGround::Grid(_) => 0,
            RecordedGround::Scenario(scenario) => match &scenario.files {
                RecordedFiles::Whole(files) => files.window_s().0,
                RecordedFiles::Local(files) => files.begin_s(),
            },
        }
    }

    /// Returns the length of a lane in metres.
    pub fn length_m(&self, name: &str) -> Result<f64> {
        Ok(self.lanes[self.number(name)?].length_m)
    }

    /// Returns the index of a lane in [`RecordedRoads::lanes`].
    pub fn number(&self, lane: &str) -> Result<usize> {
        self.numbers.get(lane).copied().with_context(|| format!("no lane `{lane}` was recorded"))
    }
}

impl RecordedScenario {
    /// Returns how far the lanes reach from west to east and from south to north, in metres.
    pub fn extent_m(&self) -> [f64; 2] {
        let places = || self.roads.lanes.iter().flat_map(|lane| &lane.shape);
        [0, 1].map(|axis| {
            let along = || places().map(|place| place[axis]);
            (along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)).max(1.0)
        })
    }
}
