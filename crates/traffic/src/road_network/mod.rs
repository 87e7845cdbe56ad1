//! A road network with its cars, and everything in which a grid of the paper differs from a scenario of the user.

pub(crate) mod grid;
pub(crate) mod scenario;

use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::agents::plan::JointPlan;
use crate::cut::forest::Region;
use crate::cut::mixed::prefix;
use crate::network::files::{NetworkFiles, for_sumo};
use crate::network::loadable::Loadable;
use crate::paper_grid::grid::Grid;
use crate::paper_grid::plans::plans;
use crate::scenario::kept::KEPT;
use crate::sim::local_forest::LocalForest;
use crate::sim::recorded_roads::RecordedRoads;
use dials_core::domain::{FirstRow, Map, Result, RoughCosts, Scenario};
use grid::{GridFiles, KEPT_AS, LOCAL_NETWORK};
use scenario::ScenarioFiles;

/// A road network with its cars. What it says of itself is known as soon as it was read.
pub(crate) struct RoadNetwork {
    pub(crate) files: Files,
    pub(crate) horizon: usize,
    /// Why SUMO cannot load the actuated programs of the lights, if it cannot. SUMO's own error would come after it has
    /// taken all memory.
    pub(crate) refuses_actuated: Option<String>,
    /// Message about files that SUMO cannot simulate, with the way out.
    pub(crate) cannot_be_simulated: String,
    pub(crate) rough_costs: RoughCosts,
    /// Name of the reward, if it is another one than the usual.
    pub(crate) unusual_reward: Option<String>,
    pub(crate) strange_files: Vec<PathBuf>,
    pub(crate) left_out: Vec<String>,
    /// Number to add to the output bias of action 1 of a new policy.
    pub(crate) switch_bias: f32,
    /// Whether cars dawdle at random. The speed factors of cars do not count.
    pub(crate) is_random: bool,
    /// Returns whether an agent is stuck that ends this share of its green steps.
    pub(crate) is_stuck: fn(f64) -> bool,
    pub(crate) rival: &'static str,
}

pub(crate) enum Files {
    Grid(Box<GridFiles>),
    Scenario(Box<ScenarioFiles>),
}

impl RoadNetwork {
    pub(crate) fn grid(&self) -> Option<Grid> {
        match &self.files {
            Files::Grid(files) => Some(files.grid),
            Files::Scenario(_) => None,
        }
    }

    /// Puts everything that the GS loads into memory.
    pub(crate) fn source(&self) -> Result<Loadable> {
        match &self.files {
            Files::Grid(files) => files.network.for_sumo(),
            Files::Scenario(files) => files.source(),
        }
    }

    pub(crate) fn recorded(&self, plan: &JointPlan) -> Result<RecordedRoads> {
        match &self.files {
            Files::Grid(files) => RecordedRoads::of_grid(files.grid, &files.network, plan.agents.clone()),
            Files::Scenario(files) => RecordedRoads::of_scenario(&files.files, plan.agents.clone()),
        }
    }

    /// Returns the roads of the first row of a local simulator, and the prefix of their names there.
    pub(crate) fn recorded_local(&self, plan: &JointPlan, forest: &LocalForest) -> Result<(RecordedRoads, String)> {
        match &self.files {
            Files::Grid(files) => {
                let agents = plans(Grid::SINGLE, &files.config);
                Ok((RecordedRoads::of_grid(Grid::SINGLE, &files.local_network, agents)?, Region(0).prefix()))
            }
            Files::Scenario(files) => Ok((RecordedRoads::of_local(&*files.local_parts()?, plan, forest)?, prefix(0))),
        }
    }

    pub(crate) fn described(&self, agents: usize) -> Scenario {
        let scenario = Scenario::new("traffic", agents, self.horizon);
        match &self.files {
            Files::Grid(files) => {
                let GridFiles { grid, network, local_network, .. } = &**files;
                let map = Map { rows: grid.rows(), columns: grid.cols(), first_row: FirstRow::Bottom };
                let local_network = (LOCAL_NETWORK.to_owned(), local_network.checksum());
                scenario.with_map(map).with_checksum(network.checksum()).with_files([local_network])
            }
            Files::Scenario(files) => {
                let scenario = scenario.with_checksum(files.files.checksum());
                // A copy in a run directory has lost the name.
                match files.name() {
                    KEPT => scenario,
                    name => scenario.with_name(name),
                }
            }
        }
    }

    /// Returns the name and the CRC-32 that timings of lights are tuned for.
    pub(crate) fn identity(&self) -> (String, u32) {
        match &self.files {
            Files::Grid(files) => {
                let network = &files.network;
                let name = network.files.net.file_name().unwrap_or_default().to_string_lossy();
                // Timings are tuned for the greatest return, so for a reward.
                let checksum = match &self.unusual_reward {
                    None => network.checksum(),
                    Some(reward) => crc32fast::hash(format!("{:08x} {reward}", network.checksum()).as_bytes()),
                };
                (name.strip_suffix(".net.xml").unwrap_or(&name).to_owned(), checksum)
            }
            Files::Scenario(files) => (files.name().to_owned(), files.files.checksum()),
        }
    }

    pub(crate) fn check_place(&self, folder: &Path) -> Result<()> {
        match &self.files {
            Files::Grid(_) => KEPT_AS.iter().try_for_each(|name| NetworkFiles::of(&folder.join(name)).check_paths()),
            Files::Scenario(_) => for_sumo(folder).map(drop),
        }
    }

    pub(crate) fn keep_files(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        match &self.files {
            Files::Grid(files) => {
                std::fs::create_dir(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
                files.network.copy_to(folder, KEPT_AS[0])?;
                files.local_network.copy_to(folder, KEPT_AS[1])?;
                Ok(KEPT_AS.map(PathBuf::from).to_vec())
            }
            Files::Scenario(files) => files.files.keep_in(folder),
        }
    }
}
