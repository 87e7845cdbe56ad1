//! The roads of a recording: a grid of the paper, or a scenario of the user.

use std::collections::HashMap;

use anyhow::{Context, Result};

use crate::agents::plan::AgentPlan;
use crate::network::contents::Network;
use crate::network::roads::{Function, Roads};
use crate::network::tree::Element;
use crate::paper_grid::grid::Grid;
use crate::scenario::SumoScenario;
use crate::sim::recorded_local::LocalFiles;

/// The roads of a recording.
#[derive(Clone, Debug)]
pub struct RecordedRoads {
    pub files: RecordedFiles,
    pub(crate) roads: Roads,
    /// Plans of the agents, in their order.
    pub(crate) agents: Vec<AgentPlan>,
    /// All lanes on which cars can be, with those inside of intersections, in the order of the net.
    pub lanes: Vec<Lane>,
    /// Numbers of the lanes, by name.
    numbers: HashMap<String, usize>,
    /// Names of the lights: one per agent, then those that keep their program.
    pub lights: Vec<String>,
}

/// What a replay is made of.
#[derive(Clone, Debug)]
pub enum RecordedFiles {
    /// Those of a grid of the paper.
    Grid(Box<GridFiles>),
    /// Those of a scenario.
    Whole(Box<SumoScenario>),
    /// Those of the local simulator of a light of a scenario.
    Local(Box<LocalFiles>),
}

#[derive(Clone, Debug)]
pub struct GridFiles {
    pub(crate) grid: Grid,
    /// Text of the net, as SUMO loaded it.
    pub(crate) net: String,
    pub(crate) vehicle_types: Vec<Element>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    pub name: String,
    pub(crate) length_m: f64,
}

impl RecordedRoads {
    /// Returns the roads of a grid with its network and agents.
    pub(crate) fn of_grid(grid: Grid, network: &Network, agents: Vec<AgentPlan>) -> Result<RecordedRoads> {
        let children = network.routes.root.children.iter();
        let vehicle_types = children.filter(|child| child.name.starts_with("vType")).cloned().collect();
        let files = RecordedFiles::Grid(Box::new(GridFiles { grid, net: network.net.text(), vehicle_types }));
        let lights = agents.iter().map(|agent| agent.light.clone()).collect();
        Ok(RecordedRoads::of_lights(files, network.roads()?, agents, lights))
    }

    /// Returns the roads of a scenario with these agents.
    pub(crate) fn of_scenario(files: &SumoScenario, agents: Vec<AgentPlan>) -> Result<RecordedRoads> {
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
        let lanes = lanes.map(|lane| Lane { name: lane.id.clone(), length_m: lane.length_m });
        let lanes: Vec<Lane> = lanes.collect();
        let numbers = lanes.iter().enumerate().map(|(number, lane)| (lane.name.clone(), number)).collect();
        RecordedRoads { files, roads, agents, lanes, numbers, lights }
    }

    /// Returns the grid, if it is one.
    pub fn grid(&self) -> Option<Grid> {
        match &self.files {
            RecordedFiles::Grid(files) => Some(files.grid),
            RecordedFiles::Whole(_) | RecordedFiles::Local(_) => None,
        }
    }

    /// Returns the second at which an episode begins.
    pub fn begin_s(&self) -> u64 {
        match &self.files {
            RecordedFiles::Grid(_) => 0,
            RecordedFiles::Whole(files) => files.window_s().0,
            RecordedFiles::Local(files) => files.begin_s(),
        }
    }

    /// Returns the index of a lane in [`RecordedRoads::lanes`].
    pub(crate) fn number(&self, lane: &str) -> Result<usize> {
        self.numbers.get(lane).copied().with_context(|| format!("no lane `{lane}` was recorded"))
    }

    /// Returns how far the lanes reach from west to east and from south to north, in metres.
    pub fn extent_m(&self) -> [f64; 2] {
        let places = || self.roads.lanes.iter().flat_map(|lane| &lane.shape);
        [0, 1].map(|axis| {
            let along = || places().map(|place| place[axis]);
            (along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)).max(1.0)
        })
    }
}
