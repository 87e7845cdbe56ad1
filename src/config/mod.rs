//! What a run is: text in, checked meaning out.
//!
//! A config is read once, checked once, and handed down; no other room reads files or flags for settings. Defaults are
//! the paper's for traffic (appendix "Hyperparameters"); the files under `configs/` say where they differ.
//!
//! - `load`, `renamed`, `written`, `seed`: from text to a [`Config`] and back, older keys included.
//! - `domain`, `traffic`, `warehouse`: the table of a domain, one of which a run has.
//! - `simulator`: what policies train on, and what predicts influence there.
//! - `check`: which values make sense.
//! - `schedule`: the periods that a config means.

mod check;
mod domain;
mod load;
mod renamed;
mod schedule;
mod seed;
mod simulator;
mod traffic;
mod warehouse;
mod written;

use serde::{Deserialize, Serialize};

pub use check::held_out_episodes;
pub use domain::{DomainConfig, DomainTable};
pub use load::{load, load_kept, to_toml};
pub use schedule::{AipTraining, Period, schedule};
pub use simulator::{Predictor, Simulator};
pub use traffic::{DSet, EntryRule, TrafficConfig};
pub use warehouse::WarehouseConfig;

use crate::base::VectorWidth;

/// A run: what is simulated, how agents learn, and when AIPs are retrained and policies evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "written::Written", into = "written::Written")]
pub struct Config {
    /// Root of all random streams of the run.
    pub seed: u64,
    /// What the policies train on.
    pub simulator: Simulator,
    /// Timesteps per agent, summed over its copies; learning rate and clip decay over them.
    pub total_steps: u64,
    /// Stop early, with the decay of `total_steps`.
    pub stop_at_steps: Option<u64>,
    /// Domain of the run: the one table of a domain that the config has. `None` for a domain that does not come from a
    /// config.
    pub domain: Option<DomainConfig>,
    pub local_simulators: LocalSimulatorsConfig,
    pub policy: PolicyConfig,
    pub ppo: PpoConfig,
    pub aip: AipConfig,
    pub evaluation: EvaluationConfig,
    pub checkpoints: CheckpointsConfig,
    pub logging: LoggingConfig,
    pub numerics: NumericsConfig,
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

impl Default for Config {
    fn default() -> Self {
        Config {
            seed: 1,
            simulator: Simulator::default(),
            total_steps: 4_000_000,
            stop_at_steps: None,
            domain: None,
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
        PolicyConfig { recurrent: None, hidden: vec![256, 128], sequence_length: 8 }
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
        if self.simulator == Simulator::Global { 1 } else { self.local_simulators.copies }
    }

    /// Returns the choice of predictor. On the GS nobody asks one, and it is the default, so that every run has the same state.
    pub fn predictor(&self) -> Predictor {
        self.simulator.predictor().unwrap_or_default()
    }

    /// Whether the loss of the influence predictors is measured: on the GS there are none.
    pub fn measures_aips(&self) -> bool {
        self.evaluation.aip_loss_episodes > 0 && self.simulator != Simulator::Global
    }

    /// Steps of an episode of the config's domain.
    pub fn horizon(&self) -> usize {
        self.domain.as_ref().expect("a config that was loaded has a domain").horizon()
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
