//! A recorded local simulator of a scenario: the local net of one light, and all that plain SUMO needs beside it to play
//! what happened there.

use std::collections::HashMap;

use anyhow::Result;

use super::local_forest::{LocalParts, RowPlace, local_options, route_name};
use super::recorded_roads::{RecordedFiles, RecordedRoads};
use crate::agents::plan::JointPlan;
use crate::cut::local_net::LocalNet;
use crate::cut::mixed::prefix;
use crate::network::roads::Roads;
use dials_core::base::AgentId;

/// What a replay of a local simulator is made of. Names are those of the local net, without the prefix of a row.
#[derive(Clone, Debug)]
pub struct LocalFiles {
    pub(crate) net: LocalNet,
    /// Text of a file with all vehicle types.
    pub(crate) types: String,
    /// Options of SUMO that say how cars drive, without `--`.
    pub(crate) options: Vec<(String, String)>,
    /// Positions at which cars have arrived, by route. Cars on other routes drive to the end.
    pub(crate) ends_m: HashMap<String, f64>,
    /// Types and speed factors of the cars that entered on the road apart, one in each second before the episode.
    pub(crate) first: Vec<(String, f64)>,
}

impl LocalFiles {
    /// Returns the second at which the episode begins.
    pub fn begin_s(&self) -> u64 {
        self.first.len() as u64
    }
}

/// Returns the roads of the first row of a forest. `first`: see [`LocalFiles::first`].
pub(crate) fn roads_of(
    parts: &LocalParts,
    plan: &JointPlan,
    row: &RowPlace,
    first: Vec<(String, f64)>,
) -> Result<RecordedRoads> {
    let AgentId(agent) = row.agent;
    let net = &parts.nets[agent];
    let name = |way: usize| route_name(0, way).strip_prefix(&prefix(0)).expect("its name begins so").to_owned();
    let ends = row.ways.routes().iter().enumerate().filter_map(|(way, route)| Some((name(way), route.end_m?)));
    let files = LocalFiles {
        net: net.clone(),
        types: parts.types.clone(),
        options: local_options(parts),
        ends_m: ends.collect(),
        first,
    };
    let gate = net.gate.iter().map(|gate| gate.light.clone());
    let lights = [plan.agents[agent].light.clone()].into_iter().chain(gate).collect();
    let agents = vec![plan.agents[agent].clone()];
    Ok(RecordedRoads::of_lights(RecordedFiles::Local(Box::new(files)), Roads::read(net.root())?, agents, lights))
}
