//! What a run is: text in, checked meaning out.
//!
//! A config is read once, checked once, and handed down; no other room reads files or flags for settings. Defaults are
//! the paper's for traffic (appendix "Hyperparameters"); the files under `configs/` say where they differ.

mod check;
mod load;
mod schedule;
mod seed;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

pub use check::held_out_episodes;
pub use load::{load, to_toml};
pub use schedule::{AipTraining, Period, schedule};

use crate::base::VectorWidth;

/// A run: what is simulated, how agents learn, and when AIPs are retrained and policies evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Root of all random streams of the run.
    #[serde(with = "seed")]
    pub seed: u64,
    /// What the policies train on.
    pub simulator: SimulatorKind,
    /// Timesteps per agent, summed over its copies; learning rate and clip decay over them.
    pub total_steps: u64,
    /// Stop early, with the decay of `total_steps`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop_at_steps: Option<u64>,
    /// The domain: this table or the next one. (Neither for a domain that does not come from a config.)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub traffic: Option<TrafficConfig>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warehouse: Option<WarehouseConfig>,
    pub local_simulators: LocalSimulatorsConfig,
    pub policy: PolicyConfig,
    pub ppo: PpoConfig,
    pub aip: AipConfig,
    pub evaluation: EvaluationConfig,
    pub checkpoints: CheckpointsConfig,
    pub logging: LoggingConfig,
    pub numerics: NumericsConfig,
}

/// What the policies train on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SimulatorKind {
    /// Local simulators with AIPs that are trained every F steps.
    #[default]
    Dials,
    /// The global simulator.
    Gs,
    /// Local simulators with random AIPs that are never trained.
    UntrainedDials,
    /// Local simulators with constant probabilities instead of AIPs, measured on the GS when DIALS would train its AIPs.
    MarginalDials,
}

impl SimulatorKind {
    /// As in configs and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SimulatorKind::Dials => "dials",
            SimulatorKind::Gs => "gs",
            SimulatorKind::UntrainedDials => "untrained-dials",
            SimulatorKind::MarginalDials => "marginal-dials",
        }
    }
}

/// The traffic domain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrafficConfig {
    /// The grid that the GS simulates: its path without `.net.xml`, relative to the config file.
    pub network: PathBuf,
    /// The single intersection that the LS simulates, likewise.
    pub local_network: PathBuf,
    /// Steps (seconds) of an episode.
    #[serde(default = "defaults::traffic_horizon")]
    pub horizon: usize,
    /// What the AIP sees.
    #[serde(default)]
    pub d_set: DSet,
    /// How an LS lets a car in.
    #[serde(default)]
    pub entry: EntryRule,
}

/// The warehouse domain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WarehouseConfig {
    /// The learning robots form a square of this side, with a ring of other robots around it.
    pub agents_per_side: usize,
    /// Steps of an episode.
    #[serde(default = "defaults::warehouse_horizon")]
    pub horizon: usize,
}

/// The d-separating set of the traffic domain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DSet {
    /// The 36 occupancy bits of the observation.
    #[default]
    #[serde(rename = "cells")]
    Cells,
    /// These and 4 bits: did a car enter this edge in the last step?
    #[serde(rename = "cells+arrivals")]
    CellsAndArrivals,
}

/// How a local traffic simulator lets a car in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EntryRule {
    /// At 6 m with 9.5 m/s, or 3 m/s where more than 8 cars are on the edge.
    #[default]
    Reference,
    /// At 5 m, as fast as is safe.
    Max,
}

/// The local simulators of an agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LocalSimulatorsConfig {
    /// Local simulators per agent, in lockstep.
    ///
    /// DEVIATION 7: our configs have 8 and not 1: with rollouts of 16 they fill the memory of 128 in one.
    pub copies: usize,
    /// Copies begin their episodes at different times.
    pub stagger: bool,
}

/// The policy and value network of an agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PolicyConfig {
    /// Width of a GRU before the hidden layers (warehouse); left out, the policy has no memory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recurrent: Option<usize>,
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// Steps over which the gradient flows back through a GRU; divides `ppo.rollout_steps`.
    pub sequence_length: usize,
    /// Traffic: added to the initial bias of the logit of "switch".
    pub initial_switch_bias: f32,
}

/// PPO, as in Schulman et al. 2017.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PpoConfig {
    /// T: steps of a rollout, after which advantages are estimated.
    pub rollout_steps: usize,
    /// Samples per agent and update; `copies` x `rollout_steps` divides it.
    pub memory: usize,
    /// Samples per agent and gradient step.
    pub minibatch: usize,
    /// Passes over the memory per update.
    pub epochs: usize,
    /// At the first step; decays linearly to 1e-10 over `total_steps`.
    pub learning_rate: f64,
    /// Discount factor.
    pub gamma: f64,
    /// Lambda of the generalised advantage estimate.
    pub gae_lambda: f64,
    /// Weight of the entropy bonus (beta).
    pub entropy: f64,
    /// Clip range (epsilon) at the first step; decays linearly to 1e-5.
    pub clip: f64,
    /// Weight of the value loss (c1).
    pub value_coefficient: f64,
    /// What the end of an episode at the horizon means for the return.
    pub time_limit: TimeLimit,
}

/// What the end of an episode at the horizon means for the return.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeLimit {
    /// Nothing comes after it.
    #[default]
    Terminal,
    /// It only cuts the recording: the value of the last observation stands for what would come.
    ///
    /// DEVIATION 8: our configs choose it, for an agent sees no clock and cannot know that an end is near.
    Bootstrap,
}

/// The approximate influence predictors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AipConfig {
    /// Width of a GRU before the hidden layers (warehouse); left out, the AIP has no memory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recurrent: Option<usize>,
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// When the AIPs are trained again after their first training, which is at step 0.
    pub retrain: Retrain,
    /// F: timesteps per agent between two trainings of the AIPs, for `retrain = "every"`.
    ///
    /// DEVIATION 12: our configs of the warehouse have 500K and not 4M: AIPs that only know how random robots move are no better
    /// than constants.
    pub retrain_every_steps: u64,
    /// For `retrain = "drift"`: by how many percent their loss on fresh episodes, as a share of that of the best constants, has
    /// to grow since right after the last training.
    pub drift_threshold: f64,
    /// GS steps per dataset, rounded up to whole episodes.
    pub dataset_steps: usize,
    /// Share of the episodes, the last ones, that only measure the loss.
    pub held_out: f64,
    pub learning_rate: f64,
    /// Samples per agent and gradient step; with a GRU whole episodes.
    pub batch: usize,
    /// Passes over the dataset per training.
    pub epochs: usize,
}

/// When AIPs are trained again. All of them are, or none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Retrain {
    /// Every F timesteps per agent, as in the paper.
    #[default]
    Every,
    /// Never.
    Once,
    /// At evaluations that find their loss on fresh episodes of the GS grown: what F should be, the AIPs tell themselves.
    Drift,
}

/// Evaluation of the joint policy on the GS.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvaluationConfig {
    /// Timesteps per agent between two evaluations; there is one at step 0 and one at the end as well.
    pub every_steps: u64,
    /// Root of the random streams of all evaluation episodes. Runs that share it are evaluated on the same traffic,
    /// whatever their own seed, so their returns can be compared episode by episode.
    #[serde(with = "seed")]
    pub seed: u64,
    /// Episodes per evaluation during training, the same ones each time.
    pub episodes: usize,
    /// Episodes of the evaluation at the end of training: the ones above and further ones.
    pub final_episodes: usize,
    /// Episodes of their own, the same ones each time, on which every evaluation measures the loss of the AIPs; 0 for
    /// none.
    pub aip_loss_episodes: usize,
}

/// Checkpoints, from which a run that was stopped goes on.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CheckpointsConfig {
    /// Timesteps per agent between two checkpoints, besides those at every evaluation and training of the AIPs. Changes no
    /// number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub every_steps: Option<u64>,
}

/// What a run writes beside its CSV files.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoggingConfig {
    /// Their numbers as an event file for TensorBoard.
    pub tensorboard: bool,
}

/// How a run computes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NumericsConfig {
    /// Width of the vector registers that multiply matrices. `"widest"` is fastest; `"256-bit"` gives the same files on every
    /// x86-64 machine with AVX2 and FMA.
    pub vector_width: VectorWidth,
}

mod defaults {
    pub fn traffic_horizon() -> usize {
        300
    }

    pub fn warehouse_horizon() -> usize {
        100
    }
}

impl Default for Config {
    fn default() -> Self {
        Config {
            seed: 1,
            simulator: SimulatorKind::default(),
            total_steps: 4_000_000,
            stop_at_steps: None,
            traffic: None,
            warehouse: None,
            local_simulators: LocalSimulatorsConfig::default(),
            policy: PolicyConfig::default(),
            ppo: PpoConfig::default(),
            aip: AipConfig::default(),
            evaluation: EvaluationConfig::default(),
            checkpoints: CheckpointsConfig::default(),
            logging: LoggingConfig::default(),
            numerics: NumericsConfig::default(),
        }
    }
}

impl Default for LocalSimulatorsConfig {
    fn default() -> Self {
        LocalSimulatorsConfig { copies: 1, stagger: false }
    }
}

impl Default for PolicyConfig {
    fn default() -> Self {
        PolicyConfig { recurrent: None, hidden: vec![256, 128], sequence_length: 8, initial_switch_bias: 0.0 }
    }
}

impl Default for PpoConfig {
    fn default() -> Self {
        PpoConfig {
            rollout_steps: 16,
            memory: 128,
            minibatch: 32,
            epochs: 3,
            learning_rate: 2.5e-4,
            gamma: 0.99,
            gae_lambda: 0.95,
            entropy: 1e-2,
            clip: 0.1,
            value_coefficient: 1.0,
            time_limit: TimeLimit::Terminal,
        }
    }
}

impl Default for AipConfig {
    fn default() -> Self {
        AipConfig {
            recurrent: None,
            hidden: vec![128, 128],
            retrain: Retrain::Every,
            retrain_every_steps: 1_000_000,
            drift_threshold: 1.5,
            dataset_steps: 10_000,
            held_out: 0.1,
            learning_rate: 1e-4,
            batch: 128,
            epochs: 100,
        }
    }
}

impl Default for EvaluationConfig {
    fn default() -> Self {
        EvaluationConfig { every_steps: 100_000, seed: 0, episodes: 20, final_episodes: 100, aip_loss_episodes: 0 }
    }
}

impl Config {
    /// Timesteps per agent after which this run ends.
    pub fn last_step(&self) -> u64 {
        self.stop_at_steps.unwrap_or(self.total_steps).min(self.total_steps)
    }

    /// Simulators per agent that the policies train on: the GS has one region of each agent.
    pub fn copies(&self) -> usize {
        if self.simulator == SimulatorKind::Gs { 1 } else { self.local_simulators.copies }
    }

    /// Whether the loss of the influence predictors is measured: on the GS there are none.
    pub fn measures_aips(&self) -> bool {
        self.evaluation.aip_loss_episodes > 0 && self.simulator != SimulatorKind::Gs
    }

    /// Steps of an episode.
    pub fn horizon(&self) -> usize {
        let traffic = self.traffic.as_ref().map(|traffic| traffic.horizon);
        traffic.or(self.warehouse.as_ref().map(|warehouse| warehouse.horizon)).expect("a checked config has a domain")
    }

    /// Steps of the sequences that a policy is trained on.
    pub fn sequence_length(&self) -> usize {
        if self.policy.recurrent.is_some() { self.policy.sequence_length } else { 1 }
    }

    /// Episodes per dataset.
    pub fn dataset_episodes(&self, horizon: usize) -> usize {
        self.aip.dataset_steps.div_ceil(horizon)
    }
}
