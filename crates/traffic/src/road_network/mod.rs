//! A road network with its cars, and everything in which a grid of the paper differs from a scenario of the user.

pub(crate) mod scenario;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::agents::plan::JointPlan;
use crate::config::{Reward, RewardTerm, TrafficConfig};
use crate::cut::forest::Region;
use crate::cut::mixed::prefix;
use crate::events::site::{Site, sites};
use crate::network::contents::Network;
use crate::network::files::{NetworkFiles, for_sumo};
use crate::network::loadable::Loadable;
use crate::network::roads::Roads;
use crate::network::tree::Element;
use crate::network::way_out::{Role, cannot_be_simulated};
use crate::paper_grid::grid::Grid;
use crate::paper_grid::plans::{joint_plan, plans};
use crate::paper_grid::recognise::{recognise_grid, recognise_local};
use crate::scenario::SumoScenario;
use crate::scenario::kept::KEPT;
use crate::scenario::programs::Chosen;
use crate::scenario::stops::Stops;
use crate::scenario::travellers::Travellers;
use crate::sim::local_forest::LocalForest;
use crate::sim::recorded_roads::RecordedRoads;
use dials_core::base::Seed;
use dials_core::domain::{FirstRow, Map, Result, RoughCosts, Scenario};
use dials_core::outside::quoted;
use scenario::ScenarioFiles;

/// Share of switches above which an agent is stuck: its lights are yellow most of the time. Agents that learn are near
/// 0.1 to 0.3. The local optimum of switching almost always is near 1, and random weights are near 0.5.
const STUCK_ABOVE: f64 = 0.75;

/// Measured with traffic_4.toml and traffic_100.toml.
const ROUGH_COSTS_OF_A_GRID: RoughCosts = RoughCosts {
    training_s: 37e-6,
    training_on_gs_s: 40e-6,
    influence_s: 1.6e-6,
    evaluation_s: 25e-6,
    process_mb: 120.0,
    agent_mb: 4.0,
};

/// Names of the two networks in a run directory, the same in every run directory.
const KEPT_AS: [&str; 2] = ["global", "local"];

/// Key of the network of the LS. Another network there is another way to train, not another scenario.
const LOCAL_NETWORK: &str = "traffic.local_network";
const ANY_LIGHT_FILE: &str = "traffic.any_light";

pub(crate) struct GridFiles {
    pub(crate) grid: Grid,
    pub(crate) network: Network,
    pub(crate) local_network: Network,
    pub(crate) config: TrafficConfig,
}

/// A road network with its cars. What it says of itself is known as soon as it was read.
pub(crate) struct RoadNetwork {
    pub(crate) files: Files,
    pub(crate) horizon: usize,
    /// Number of seconds at the beginning of an episode that figures leave out.
    pub(crate) warm_up_s: u64,
    /// Why SUMO cannot load the actuated programs of the lights, if it cannot. SUMO's own error would come after it has
    /// taken all memory.
    pub(crate) refuses_actuated: Option<String>,
    pub(crate) rough_costs: RoughCosts,
    /// Name of the reward, if it is another one than the usual.
    pub(crate) unusual_reward: Option<String>,
    pub(crate) strange_files: Vec<PathBuf>,
    pub(crate) left_out: Vec<String>,
    pub(crate) warnings: Vec<String>,
    /// Number to add to the output bias of action 1 of a new policy.
    pub(crate) switch_bias: f32,
    /// Whether cars dawdle at random. The speed factors of cars do not count.
    pub(crate) is_random: bool,
    pub(crate) is_stuck: fn(Changes) -> bool,
    pub(crate) rival: &'static str,
}

/// How often an agent changes its light, in the mean of some episodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Changes {
    /// Share of its green steps that it ends.
    pub(crate) p_switch: f64,
    /// Longest time that somebody stood at its red, in seconds; 0 on grids.
    pub(crate) longest_wait_s: f64,
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

    /// Returns the second of the simulation at which an episode begins.
    pub(crate) fn begin_s(&self) -> u64 {
        match &self.files {
            Files::Grid(_) => 0,
            Files::Scenario(scenario) => scenario.files.window_s().0,
        }
    }

    pub(crate) fn roads(&self) -> Result<Roads> {
        match &self.files {
            Files::Grid(files) => files.network.roads(),
            Files::Scenario(scenario) => scenario.files.roads(),
        }
    }

    /// Returns the path of the net, for messages.
    pub(crate) fn net_name(&self) -> String {
        match &self.files {
            Files::Grid(files) => quoted(&files.network.files.net),
            Files::Scenario(scenario) => quoted(scenario.files.net_path()),
        }
    }

    /// Returns which programs of lights were chosen, and the elements `<tlLogic>`, in SUMO's order.
    pub(crate) fn chosen_programs(&self) -> Option<(&Chosen, Vec<&Element>)> {
        let Files::Scenario(scenario) = &self.files else { return None };
        let roots = [scenario.files.net()].into_iter().chain(scenario.files.additional());
        Some((scenario.files.chosen(), roots.flat_map(|root| root.all("tlLogic")).collect()))
    }

    /// Returns the ids of the elements `<WAUT>` of the additional files.
    pub(crate) fn wauts(&self) -> Vec<String> {
        let Files::Scenario(scenario) = &self.files else { return Vec::new() };
        let wauts = scenario.files.additional().flat_map(|root| root.all("WAUT"));
        wauts.filter_map(|waut| waut.attribute("id")).map(str::to_owned).collect()
    }

    /// Returns the message about files that SUMO cannot simulate in the episode of a seed, with the way out.
    pub(crate) fn cannot_be_simulated(&self, episode: u64) -> String {
        match &self.files {
            Files::Grid(files) => cannot_be_simulated(&files.network.files.net, Role::Global),
            Files::Scenario(scenario) => {
                let drawn = scenario.files.drawn_by(Seed::new(episode));
                let playing = drawn.and_then(|number| scenario.files.playing(number).ok());
                playing.as_ref().unwrap_or(&scenario.files).cannot_be_simulated()
            }
        }
    }

    /// Returns an error if no episode without a vehicle is right. On a grid random numbers decide. `playing`: the scenario with
    /// the route file of the episode, if there are several.
    pub(crate) fn check_not_empty(&self, playing: Option<&SumoScenario>) -> Result<()> {
        match &self.files {
            Files::Grid(_) => Ok(()),
            Files::Scenario(scenario) => playing.unwrap_or(&scenario.files).check_not_empty(),
        }
    }

    /// Returns the number of route files of which each episode plays one. 0: all episodes play the same.
    pub(crate) fn route_files(&self) -> usize {
        match &self.files {
            Files::Grid(_) => 0,
            Files::Scenario(scenario) => scenario.files.drawn_files().len(),
        }
    }

    /// Returns the number of the route file that an episode plays, if there are several.
    pub(crate) fn drawn_by(&self, episode: Seed) -> Option<usize> {
        match &self.files {
            Files::Grid(_) => None,
            Files::Scenario(scenario) => scenario.files.drawn_by(episode),
        }
    }

    /// Returns the scenario with one of several route files.
    pub(crate) fn playing(&self, number: usize) -> Result<SumoScenario> {
        let Files::Scenario(scenario) = &self.files else { bail!("a grid has one route file") };
        scenario.files.playing(number)
    }

    /// Returns what SUMO loads. `playing`: as in [`RoadNetwork::check_not_empty`].
    pub(crate) fn source(&self, playing: Option<&SumoScenario>) -> Result<Loadable> {
        match &self.files {
            Files::Grid(files) => files.network.for_sumo(),
            Files::Scenario(files) => files.source(playing),
        }
    }

    /// Returns who travels. `None`: on a grid, where all are alike.
    pub(crate) fn travellers(&self) -> Option<Travellers> {
        match &self.files {
            Files::Grid(_) => None,
            Files::Scenario(scenario) => Some(scenario.files.travellers()),
        }
    }

    /// Returns where vehicles stop on their way. On a grid nobody does. `playing`: as in [`RoadNetwork::check_not_empty`].
    pub(crate) fn stops(&self, playing: Option<&SumoScenario>) -> Result<Stops> {
        match &self.files {
            Files::Grid(_) => Ok(Stops::default()),
            Files::Scenario(scenario) => Ok(playing.unwrap_or(&scenario.files).stops(&scenario.files.roads()?)),
        }
    }

    pub(crate) fn recorded(&self, plan: &JointPlan) -> Result<RecordedRoads> {
        match &self.files {
            Files::Grid(files) => RecordedRoads::of_grid(files.grid, &files.network, plan.agents.clone()),
            Files::Scenario(files) => RecordedRoads::of_scenario(&files.files, plan.agents.clone()),
        }
    }

    /// Returns the lights with the phases and detectors of the event log.
    pub(crate) fn sites(&self, plan: &JointPlan) -> Result<Vec<Site>> {
        Ok(sites(&self.roads()?, &plan.agents))
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
                let policy = files.any_light.iter().map(|policy| (ANY_LIGHT_FILE.to_owned(), policy.digest()));
                let scenario = scenario.with_checksum(files.files.checksum()).with_files(policy);
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
            Files::Scenario(files) => files.keep_in(folder),
        }
    }
}

/// Finds the networks, as [`crate::Traffic::open`] says.
pub(crate) fn open_grid(config: &TrafficConfig) -> Result<(RoadNetwork, JointPlan)> {
    let [global, local] = [&config.network, &config.local_network].map(|prefix| NetworkFiles::of(prefix));
    global.check()?;
    local.check()?;
    let local_network = recognise_local(&local)?.network;
    let global = recognise_grid(&global)?;
    let (grid, network) = (global.grid, global.network);
    let reward = &config.reward;
    let network = RoadNetwork {
        horizon: config.horizon,
        warm_up_s: config.warm_up_s,
        refuses_actuated: None,
        rough_costs: ROUGH_COSTS_OF_A_GRID,
        unusual_reward: (*reward != Reward::from(RewardTerm::MeanSpeed)).then(|| reward.name()),
        strange_files: [&network, &local_network].map(|network| network.files.net.clone()).to_vec(),
        left_out: Vec::new(),
        warnings: Vec::new(),
        // DEVIATION 11: our configs begin with a bias against switching, so that fewer agents get stuck in switching
        // always.
        switch_bias: config.initial_switch_bias,
        is_random: false,
        is_stuck: |changes| changes.p_switch > STUCK_ABOVE,
        rival: "actuated",
        files: Files::Grid(Box::new(GridFiles { grid, network, local_network, config: config.clone() })),
    };
    Ok((network, joint_plan(grid, config)))
}
