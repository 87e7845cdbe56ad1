//! A grid of the paper: our own networks, compared with what this program writes.

use super::{Files, RoadNetwork};
use crate::agents::plan::JointPlan;
use crate::config::{Reward, RewardTerm, TrafficConfig};
use crate::network::contents::Network;
use crate::network::files::NetworkFiles;
use crate::network::way_out::{Role, cannot_be_simulated};
use crate::paper_grid::grid::Grid;
use crate::paper_grid::plans::joint_plan;
use crate::paper_grid::recognise::{recognise_grid, recognise_local};
use dials_core::domain::{Result, RoughCosts};

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
pub(super) const KEPT_AS: [&str; 2] = ["global", "local"];

/// Key of the network of the LS. Another network there is another way to train, not another scenario.
pub(super) const LOCAL_NETWORK: &str = "traffic.local_network";

pub(crate) struct GridFiles {
    pub(crate) grid: Grid,
    pub(crate) network: Network,
    pub(crate) local_network: Network,
    pub(crate) config: TrafficConfig,
}

/// Finds the networks, as [`crate::Traffic::open`] says.
pub(crate) fn open(config: &TrafficConfig) -> Result<(RoadNetwork, JointPlan)> {
    let [global, local] = [&config.network, &config.local_network].map(|prefix| NetworkFiles::of(prefix));
    global.check()?;
    local.check()?;
    let local_network = recognise_local(&local)?.network;
    let global = recognise_grid(&global)?;
    let (grid, network) = (global.grid, global.network);
    let reward = &config.reward;
    let network = RoadNetwork {
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
        files: Files::Grid(Box::new(GridFiles { grid, network, local_network, config: config.clone() })),
    };
    Ok((network, joint_plan(grid, config)))
}
