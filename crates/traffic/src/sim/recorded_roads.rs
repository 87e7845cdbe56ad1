//! The roads of a recording, and the files that a replay of it is made of.

use std::collections::HashMap;

use anyhow::{Context, Result};

use super::local_forest::{LocalForest, LocalParts, local_options, route_name};
use crate::agents::plan::{AgentPlan, JointPlan};
use crate::cut::local_net::LocalNet;
use crate::cut::mixed::prefix;
use crate::network::contents::Network;
use crate::network::roads::{Function, Roads};
use crate::network::tree::Element;
use crate::paper_grid::grid::Grid;
use crate::scenario::SumoScenario;
use crate::scenario::stops::Stop;

#[derive(Clone, Debug)]
pub struct RecordedRoads {
    pub files: RecordedFiles,
    pub(crate) roads: Roads,
    pub(crate) agents: Vec<AgentPlan>,
    /// Names of all lanes on which cars can be, with those inside of intersections, in the order of the net.
    pub lanes: Vec<String>,
    numbers: HashMap<String, usize>,
    /// Names of the lights: one per agent, then those that keep their program.
    pub lights: Vec<String>,
}

#[derive(Clone, Debug)]
pub enum RecordedFiles {
    Grid(Box<GridFiles>),
    Whole(Box<SumoScenario>),
    Local(Box<LocalFiles>),
}

#[derive(Clone, Debug)]
pub struct GridFiles {
    pub(crate) grid: Grid,
    pub(crate) net: String,
    pub(crate) vehicle_types: Vec<Element>,
}

/// What a replay of a local simulator is made of. Names are those of the local net, without the prefix of a row.
#[derive(Clone, Debug)]
pub struct LocalFiles {
    pub(crate) net: LocalNet,
    pub(crate) types: String,
    pub(crate) steps_per_s: u32,
    /// Options of SUMO that say how cars drive, without `--`.
    pub(crate) options: Vec<(String, String)>,
    /// Positions at which cars have arrived, by route. Cars on other routes drive to the end.
    pub(crate) ends_m: HashMap<String, f64>,
    /// Stops on the way, by route.
    pub(crate) stops: HashMap<String, Vec<Stop>>,
    /// Types and speed factors of the cars that entered on the road apart, one in each second before the episode.
    pub(crate) first: Vec<(String, f64)>,
}

impl LocalFiles {
    pub fn begin_s(&self) -> u64 {
        self.first.len() as u64
    }
}

impl RecordedRoads {
    pub(crate) fn of_grid(grid: Grid, network: &Network, agents: Vec<AgentPlan>) -> Result<RecordedRoads> {
        let children = network.routes.root.children.iter();
        let vehicle_types = children.filter(|child| child.name.starts_with("vType")).cloned().collect();
        let files = RecordedFiles::Grid(Box::new(GridFiles { grid, net: network.net.text(), vehicle_types }));
        Ok(RecordedRoads::new(files, network.roads()?, agents, &[]))
    }

    pub(crate) fn of_scenario(files: &SumoScenario, agents: Vec<AgentPlan>) -> Result<RecordedRoads> {
        let roads = files.roads()?;
        // SUMO has no light that controls nothing.
        let programs = roads.programs.iter().filter(|program| roads.of_light(&program.light).next().is_some());
        let lights: Vec<String> = programs.map(|program| program.light.clone()).collect();
        Ok(RecordedRoads::new(RecordedFiles::Whole(Box::new(files.clone())), roads, agents, &lights))
    }

    /// Returns the same roads with the files that one episode plays.
    pub(super) fn playing(&self, scenario: &SumoScenario) -> RecordedRoads {
        RecordedRoads { files: RecordedFiles::Whole(Box::new(scenario.clone())), ..self.clone() }
    }

    pub(crate) fn of_local(parts: &LocalParts, plan: &JointPlan, forest: &LocalForest) -> Result<RecordedRoads> {
        let row = &forest.rows[0];
        let (agent, net) = (&plan.agents[row.agent.0], &parts.nets[row.agent.0]);
        let name = |route: usize| route_name(0, route).strip_prefix(&prefix(0)).expect("its name begins so").to_owned();
        let routes = row.local_routes.routes.iter().enumerate();
        let files = LocalFiles {
            net: net.clone(),
            types: parts.types.clone(),
            steps_per_s: parts.steps_per_s,
            options: local_options(parts),
            stops: routes.clone().map(|(number, route)| (name(number), route.stops.clone())).collect(),
            ends_m: routes.filter_map(|(number, route)| Some((name(number), route.end_m?))).collect(),
            first: forest.first.clone(),
        };
        let gate: Vec<String> = net.gate.iter().map(|gate| gate.light.clone()).collect();
        let (files, roads) = (RecordedFiles::Local(Box::new(files)), Roads::read(net.root())?);
        Ok(RecordedRoads::new(files, roads, vec![agent.clone()], &gate))
    }

    /// `others`: lights, besides those of the agents.
    fn new(files: RecordedFiles, roads: Roads, agents: Vec<AgentPlan>, others: &[String]) -> RecordedRoads {
        let mut lights: Vec<String> = agents.iter().map(|agent| agent.light.clone()).collect();
        for light in others {
            if !lights.contains(light) {
                lights.push(light.clone());
            }
        }
        let drivable = |function| matches!(function, Function::Road | Function::Internal);
        let lanes = roads.lanes.iter().filter(|lane| drivable(roads.edge(lane.edge).function));
        let lanes: Vec<String> = lanes.map(|lane| lane.id.clone()).collect();
        let numbers = lanes.iter().enumerate().map(|(number, lane)| (lane.clone(), number)).collect();
        RecordedRoads { files, roads, agents, lanes, numbers, lights }
    }

    pub fn grid(&self) -> Option<Grid> {
        match &self.files {
            RecordedFiles::Grid(files) => Some(files.grid),
            _ => None,
        }
    }

    pub fn begin_s(&self) -> u64 {
        match &self.files {
            RecordedFiles::Grid(_) => 0,
            RecordedFiles::Whole(files) => files.window_s().0,
            RecordedFiles::Local(files) => files.begin_s(),
        }
    }

    /// Returns SUMO's steps in a second.
    pub(crate) fn steps_per_s(&self) -> u32 {
        match &self.files {
            RecordedFiles::Grid(_) => 1,
            RecordedFiles::Whole(files) => files.steps_per_s(),
            RecordedFiles::Local(files) => files.steps_per_s,
        }
    }

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
