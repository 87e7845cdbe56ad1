//! The settings of learning: how agents learn, and when influence predictors are retrained and policies evaluated.
//!
//! Whoever reads them from a file adds the table of a domain. Defaults are the paper's for traffic (appendix
//! "Hyperparameters"); the files under `configs/` show where they differ.
//!
//! - `simulator`: what the policies train on, and what predicts the influence there.
//! - `ppo`: the table of the algorithm. `imitation`: the imitation of a controller before it.
//! - `check`: which values make sense. `seed`: seeds in files.
//! - `schedule`: the periods of a run.

mod check;
mod imitation;
mod ppo;
mod schedule;
mod seed;
mod simulator;

use serde::{Deserialize, Serialize};

pub use check::held_out_episodes;
pub use imitation::ImitationConfig;
pub use ppo::{PpoConfig, TimeLimit};
pub use schedule::{AipTraining, Period, may_end_at, rest_of_schedule, schedule};
pub use simulator::{Predictor, SHORT_FORMS, ShortForm, Simulator};

/// How agents learn, and when AIPs (approximate influence predictors) are retrained and policies evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Root of all random streams of the run.
    #[serde(with = "seed")]
    pub seed: u64,
    /// What the policies train on.
    pub simulator: Simulator,
    /// What predicts the influence in local simulators.
    pub predictor: Predictor,
    /// Timesteps per agent, summed over its copies. Learning rate and clip decay over them.
    pub total_steps: u64,
    /// Timesteps per agent after which to stop early. The decay is still over `total_steps`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop_at_steps: Option<u64>,
    pub local_simulators: LocalSimulatorsConfig,
    pub gs: GsConfig,
    pub policy: PolicyConfig,
    pub imitation: ImitationConfig,
    pub ppo: PpoConfig,
    pub aip: AipConfig,
    pub evaluation: EvaluationConfig,
    pub checkpoints: CheckpointsConfig,
}

/// Settings of an agent's local simulators.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LocalSimulatorsConfig {
    /// Number of local simulators per agent, in lockstep.
    ///
    /// DEVIATION 7: our configs have 8 and not 1: with rollouts of 16 they fill the memory of 128 in one.
    pub copies: usize,
    /// Whether copies begin their episodes at different times.
    pub stagger: bool,
}

/// Settings of training on the GS (global simulator). No other training reads them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GsConfig {
    /// Whether the agents of a kind share one policy, and bootstrap with the value of the last one of them, as in the
    /// authors' code. See DEVIATION 6: by default every agent learns for itself.
    pub shared_policy: bool,
}

/// Settings of an agent's policy and value network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PolicyConfig {
    /// Width of a GRU before the hidden layers (warehouse). If left out, the policy has no memory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recurrent: Option<usize>,
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// Number of steps over which the gradient flows back through a GRU; divides `ppo.rollout_steps`.
    pub sequence_length: usize,
    /// Hand-coded controller that the policies imitate before PPO begins, as the command line names it. If left out,
    /// policies begin at random.
    ///
    /// DEVIATION 14: the paper's policies begin at random. With this key they begin with what an engineer knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imitate: Option<String>,
    /// Whether the value has a network of its own, with the same hidden layers as the policy.
    ///
    /// DEVIATION 15: in the paper policy and value share all layers but the last. Then the value's large errors change
    /// the layers that the policy needs. Our configs of the paper's grids choose it.
    pub separate_critic: bool,
    /// Timesteps per agent after which all agents of a kind get the mean of their policies. If left out, they never do.
    ///
    /// DEVIATION 19: in the paper every agent keeps its own policy. With this key agents also learn from each other, and
    /// still train in parallel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub average_every_steps: Option<u64>,
}

/// Settings of the approximate influence predictors (AIPs).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AipConfig {
    /// Width of a GRU before the hidden layers (warehouse). If left out, the AIP has no memory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recurrent: Option<usize>,
    /// Widths of the hidden layers; empty for none.
    pub hidden: Vec<usize>,
    /// When the AIPs are trained again after their first training, which is at step 0.
    pub retrain: Retrain,
    /// Timesteps per agent between two trainings of the AIPs (F), for `retrain = "every"`.
    ///
    /// DEVIATION 12: our configs of the warehouse have 500K and not 4M: AIPs that only know how random robots move are
    /// no better than constants.
    pub retrain_every_steps: u64,
    /// Threshold in percent for `retrain = "drift"`. The AIPs' loss on new episodes is divided by the loss of the best
    /// constants. The AIPs are retrained when this share has grown by more than the threshold since their last
    /// training.
    pub drift_threshold: f64,
    /// Number of GS (global simulator) steps per dataset, rounded up to whole episodes, at least two: one is held out.
    pub dataset_steps: usize,
    /// Share of the episodes, the last ones, that only measure the loss. They also decide when `patience` is over, and
    /// which sources keep their constants.
    pub held_out: f64,
    pub learning_rate: f64,
    /// Number of samples per agent and gradient step; with a GRU, of whole episodes.
    pub batch: usize,
    /// Number of passes over the dataset per training.
    pub epochs: usize,
    /// Number of epochs without a lower loss on the held-out episodes after which the training of an agent's AIP ends. The
    /// AIP then has the parameters of its best epoch. If left out, all epochs are trained and the last one counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub patience: Option<usize>,
    /// Share by which each gradient step makes the weights smaller, divided by the learning rate.
    pub weight_decay: f64,
    /// Whether an AIP corrects the marginals: its outputs are added to their logits. A source whose AIP is not better
    /// than its marginals on the held-out episodes keeps the marginals.
    ///
    /// DEVIATION 16: the paper's AIPs know nothing of marginals. Where cars are rare, as on real maps, they are worse
    /// than marginals.
    pub correct_marginals: bool,
}

/// When AIPs are trained again: all of them or none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Retrain {
    /// Every F timesteps per agent, as in the paper.
    #[default]
    Every,
    /// Never.
    Once,
    /// After evaluations that find that the AIPs' loss on new episodes of the GS has grown. The AIPs then determine F.
    Drift,
}

/// Evaluation of the joint policy on the GS.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvaluationConfig {
    /// Timesteps per agent between two evaluations. There is also one at step 0 and one at the end.
    pub every_steps: u64,
    /// Root of the random streams of all evaluation episodes. Runs with the same value are evaluated on the same
    /// traffic, whatever their own seed. So their returns can be compared episode by episode.
    #[serde(with = "seed")]
    pub seed: u64,
    /// Number of episodes per evaluation during training, the same ones each time.
    pub episodes: usize,
    /// Number of episodes of the evaluation at the end of training: the episodes above and further ones.
    pub final_episodes: usize,
    /// Number of separate episodes, the same ones each time, on which every evaluation measures the loss of the AIPs; 0
    /// for none.
    pub aip_loss_episodes: usize,
}

/// Settings of the checkpoints, from which a stopped run continues.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CheckpointsConfig {
    /// Timesteps per agent between two checkpoints, besides those at every evaluation and training of the AIPs. Changes
    /// no number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub every_steps: Option<u64>,
}

impl Default for Config {
    fn default() -> Self {
        Config {
            seed: 1,
            simulator: Simulator::default(),
            predictor: Predictor::default(),
            total_steps: 4_000_000,
            stop_at_steps: None,
            local_simulators: LocalSimulatorsConfig::default(),
            gs: GsConfig::default(),
            policy: PolicyConfig::default(),
            imitation: ImitationConfig::default(),
            ppo: PpoConfig::default(),
            aip: AipConfig::default(),
            evaluation: EvaluationConfig::default(),
            checkpoints: CheckpointsConfig::default(),
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
        PolicyConfig {
            recurrent: None,
            hidden: vec![256, 128],
            sequence_length: 8,
            imitate: None,
            separate_critic: false,
            average_every_steps: None,
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
            patience: None,
            weight_decay: 0.0,
            correct_marginals: false,
        }
    }
}

impl Default for EvaluationConfig {
    fn default() -> Self {
        EvaluationConfig { every_steps: 100_000, seed: 0, episodes: 20, final_episodes: 100, aip_loss_episodes: 0 }
    }
}

impl Config {
    /// Returns the timesteps per agent after which this run ends.
    pub fn last_step(&self) -> u64 {
        self.stop_at_steps.unwrap_or(self.total_steps).min(self.total_steps)
    }

    /// Returns the timesteps per agent at which the run ends: at the first update of the policies at or after its last
    /// step.
    pub fn end(&self) -> u64 {
        self.update_at_or_after(self.last_step())
    }

    /// Returns the timesteps per agent at the first update of the policies at or after a step.
    pub fn update_at_or_after(&self, step: u64) -> u64 {
        step.checked_next_multiple_of(self.ppo.memory as u64).unwrap_or(u64::MAX)
    }

    /// Returns the number of simulators per agent that the policies train on. The GS has one region of each agent.
    pub fn copies(&self) -> usize {
        if self.simulator == Simulator::Global { 1 } else { self.local_simulators.copies }
    }

    /// Returns the choice of predictor. The GS uses none; there it is the default, so that every run has the same
    /// state.
    pub fn predictor(&self) -> Predictor {
        self.predictor_in_use().unwrap_or_default()
    }

    /// Returns whether the loss of the influence predictors is measured. On the GS there are none.
    pub fn measures_aips(&self) -> bool {
        self.evaluation.aip_loss_episodes > 0 && self.simulator != Simulator::Global
    }

    /// Returns the number of steps of the sequences that a policy is trained on.
    pub fn sequence_length(&self) -> usize {
        if self.policy.recurrent.is_some() { self.policy.sequence_length } else { 1 }
    }

    /// Returns whether the agents of a kind share one policy.
    pub fn shares_policies(&self) -> bool {
        self.gs.shared_policy && self.simulator == Simulator::Global
    }

    /// Returns whether the policies of a kind begin as one: the mean of random ones that differ would be worse than each.
    pub fn begins_with_one_policy(&self) -> bool {
        self.shares_policies() || self.policy.average_every_steps.is_some()
    }

    /// Returns the timesteps per agent at the beginning of training in which only the critic learns.
    pub fn critic_steps(&self) -> u64 {
        if self.policy.imitate.is_some() { self.imitation.critic_steps } else { 0 }
    }

    /// Returns the number of episodes per dataset: at least two, because one is held out.
    pub fn dataset_episodes(&self, horizon: usize) -> usize {
        self.aip.dataset_steps.div_ceil(horizon).max(2)
    }
}
