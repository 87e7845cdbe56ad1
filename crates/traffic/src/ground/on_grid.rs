//! A grid of the paper: our own networks, compared with what this program writes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail, ensure};

use super::{About, Ground};
use crate::agents::region;
use crate::config::{Reward, RewardTerm, TrafficConfig};
use crate::light;
use crate::network::contents::Network;
use crate::network::files::NetworkFiles;
use crate::network::loadable::Loadable;
use crate::network::roads::Roads;
use crate::network::way_out::{Role, cannot_be_simulated};
use crate::paper_grid::grid::Grid;
use crate::paper_grid::plans::plans;
use crate::paper_grid::recognise::{recognise_grid, recognise_local};
use crate::sim::local::{self, LocalTraffic};
use crate::sim::local_forest::LocalParts;
use crate::sim::recorded_roads::RecordedRoads;
use crate::sim::recording::Tape;
use crate::sim::trace::route::Route;
use dials_core::base::Rows;
use dials_core::domain::{Beginning, FirstRow, LocalSimulator, Map, Result, RoughCosts, Scenario};

/// Share of switches above which an agent is stuck: its lights are yellow most of the time. Agents that learn are near
/// 0.1 to 0.3. The local optimum of switching almost always is near 1, and random weights are near 0.5.
const STUCK_ABOVE: f64 = 0.75;

/// Measured with traffic_4.toml and traffic_100.toml.
const ROUGH_COSTS: RoughCosts = RoughCosts {
    training_s: 37e-6,
    training_on_gs_s: 40e-6,
    influence_s: 1.6e-6,
    evaluation_s: 25e-6,
    process_mb: 120.0,
    agent_mb: 4.0,
};

/// Names of the two networks in a run directory, the same in every run directory.
const KEPT_AS: [&str; 2] = ["global", "local"];

/// Key of the network of the LS (local simulator). Another network there is another way to train, not another scenario.
const LOCAL_NETWORK: &str = "traffic.local_network";

/// A grid with its files.
pub(crate) struct OnGrid {
    about: About,
    grid: Grid,
    network: Network,
    local_network: Network,
    config: TrafficConfig,
}

impl OnGrid {
    /// Finds the networks and compares them with what this program makes. An error says which file is missing or wrong
    /// and how to make it.
    pub(crate) fn open(config: &TrafficConfig) -> Result<OnGrid> {
        let [global, local] = [&config.network, &config.local_network].map(|prefix| NetworkFiles::of(prefix));
        global.check()?;
        local.check()?;
        let local = recognise_local(&local)?;
        let global = recognise_grid(&global)?;
        let (grid, network, local_network) = (global.grid, global.network, local.network);
        let reward = &config.reward;
        let about = About {
            grid: Some(grid),
            horizon: config.horizon,
            refuses_actuated: None,
            cannot_be_simulated: cannot_be_simulated(&network.files.net, Role::Global),
            rough_costs: ROUGH_COSTS,
            unusual_reward: (*reward != Reward::from(RewardTerm::MeanSpeed)).then(|| reward.name()),
            strange_files: [&network, &local_network].map(|network| network.files.net.clone()).to_vec(),
            left_out: Vec::new(),
            // DEVIATION 11: our configs begin with a bias against switching, so that fewer agents get stuck in switching
            // always.
            switch_bias: config.initial_switch_bias,
            is_random: false,
            is_stuck: |p_switch| p_switch > STUCK_ABOVE,
            rival: "actuated",
        };
        Ok(OnGrid { about, grid, network, local_network, config: config.clone() })
    }

    /// Returns its grid.
    pub(crate) fn shape(&self) -> Grid {
        self.grid
    }

    fn play_local_step(&self) -> Result<()> {
        let mut ls = self.local(1, None)?;
        ls.reset(&Beginning::first([0]))?;
        ls.step(&[light::KEEP], &Rows::from_vec(vec![1; region::EDGES], region::EDGES))?;
        let dropped = ls.counters().into_iter().find(|(name, _)| *name == local::DROPPED).map_or(0, |(_, count)| count);
        ensure!(dropped == 0, "{dropped} cars did not fit on its empty edges");
        Ok(())
    }
}

impl Ground for OnGrid {
    fn about(&self) -> &About {
        &self.about
    }

    fn source(&self) -> Result<Loadable> {
        self.network.for_sumo()
    }

    fn roads(&self) -> Result<Roads> {
        self.network.roads()
    }

    fn recorded(&self) -> Result<RecordedRoads> {
        RecordedRoads::of_grid(self.grid, &self.network, plans(self.grid, &self.config))
    }

    fn route(&self, _edges: &str) -> Result<Route> {
        bail!("only a scenario has routes to choose from; on a grid the middle row is drawn, so leave the option out")
    }

    fn local(&self, rows: usize, tape: Option<&Tape>) -> Result<LocalTraffic> {
        LocalTraffic::load(&self.local_network, rows, &self.config, tape)
    }

    fn local_parts(&self) -> Result<Option<Arc<LocalParts>>> {
        Ok(None)
    }

    fn try_local(&self) -> Result<()> {
        self.play_local_step().with_context(|| cannot_be_simulated(&self.local_network.files.net, Role::Local))
    }

    fn scenario(&self, agents: usize) -> Result<Scenario> {
        let scenario = Scenario::new("traffic", agents, self.about.horizon);
        let map = Map { rows: self.grid.rows(), columns: self.grid.cols(), first_row: FirstRow::Bottom };
        let local_network = (LOCAL_NETWORK.to_owned(), self.local_network.checksum());
        Ok(scenario.with_map(map).with_checksum(self.network.checksum()).with_files([local_network]))
    }

    fn identity(&self) -> (String, u32) {
        let name = self.network.files.net.file_name().unwrap_or_default().to_string_lossy();
        // Timings are tuned for the greatest return, so for a reward.
        let checksum = match &self.about.unusual_reward {
            None => self.network.checksum(),
            Some(reward) => crc32fast::hash(format!("{:08x} {reward}", self.network.checksum()).as_bytes()),
        };
        (name.strip_suffix(".net.xml").unwrap_or(&name).to_owned(), checksum)
    }

    fn check_place(&self, folder: &Path) -> Result<()> {
        KEPT_AS.iter().try_for_each(|name| NetworkFiles::of(&folder.join(name)).check_paths())
    }

    fn keep_files(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        std::fs::create_dir(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        for (network, name) in [&self.network, &self.local_network].into_iter().zip(KEPT_AS) {
            network.copy_to(folder, name)?;
        }
        Ok(KEPT_AS.map(PathBuf::from).to_vec())
    }
}
