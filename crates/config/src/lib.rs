//! The config of a run: from text to checked settings.
//!
//! A config is read once, checked once, and passed on. No other room reads files or flags for settings. Defaults are
//! the paper's for traffic (appendix "Hyperparameters"); the files under `configs/` show where they differ.
//!
//! - `load`, `written`, `seed`: from text to a [`Config`] and back.
//! - `domain`, `warehouse`: the table of a domain; a run has one.
//! - `traffic_table`: the two ways to fill the table of traffic: `traffic` for a grid, `scenario` for a .sumocfg; the
//!   `reward` of both, and the `yellow` of scenarios.
//! - [`sumocfg`], `sumo_options`, [`sumo_time`]: a .sumocfg read, and which of its options this program carries over.
//! - `simulator`: what the policies train on, and what predicts the influence there.
//! - `imitation`: the imitation of a controller before PPO.
//! - `check`: which values make sense.
//! - `schema`: the JSON schema of a config, for editors.
//! - `schedule`: the periods of a run.
//! - [`resume`]: what may change when a run is resumed.

mod check;
mod domain;
mod imitation;
mod load;
pub mod resume;
mod reward;
mod scenario;
mod schedule;
mod schema;
mod seed;
mod simulator;
mod sumo_options;
pub mod sumo_time;
pub mod sumocfg;
mod traffic;
mod traffic_table;
mod warehouse;
mod written;
mod yellow;

use serde::{Deserialize, Serialize};

pub use check::held_out_episodes;
pub use domain::{DomainConfig, DomainTable};
pub use imitation::ImitationConfig;
pub use load::{LARGEST_FILE, load, load_kept, to_toml};
pub use resume::CHANGEABLE;
pub use reward::{Reward, RewardTerm};
pub use scenario::{Observation, ScenarioConfig};
pub use schedule::{AipTraining, Period, rest_of_schedule, schedule};
pub use schema::schema;
pub use simulator::{Predictor, Simulator};
pub use traffic::{ClockOffsets, DSet, EntryRule, TrafficConfig, UntilFirstSwitch};
pub use warehouse::WarehouseConfig;
pub use yellow::Yellow;

use stacknets::VectorWidth;

/// A run: what is simulated, how agents learn, and when AIPs (approximate influence predictors) are retrained and
/// policies evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "written::Written", into = "written::Written")]
pub struct Config {
    /// Root of all random streams of the run.
    pub seed: u64,
    /// What the policies train on.
    pub simulator: Simulator,
    /// Timesteps per agent, summed over its copies. Learning rate and clip decay over them.
    pub total_steps: u64,
    /// Timesteps per agent after which to stop early. The decay is still over `total_steps`.
    pub stop_at_steps: Option<u64>,
    /// Domain of the run, from the one table of a domain in the config. `None` for a domain that does not come from a
    /// config.
    pub domain: Option<DomainConfig>,
    pub local_simulators: LocalSimulatorsConfig,
    pub gs: GsConfig,
    pub policy: PolicyConfig,
    pub imitation: ImitationConfig,
    pub ppo: PpoConfig,
    pub aip: AipConfig,
    pub evaluation: EvaluationConfig,
    pub checkpoints: CheckpointsConfig,
    pub logging: LoggingConfig,
    pub numerics: NumericsConfig,
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

/// Settings of PPO, as in Schulman et al. 2017.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PpoConfig {
    /// Number of steps of a rollout (T), after which advantages are estimated.
    pub rollout_steps: usize,
    /// Number of samples per agent and update; a multiple of `copies` x `rollout_steps`.
    pub memory: usize,
    /// Number of samples per agent and gradient step.
    pub minibatch: usize,
    /// Number of passes over the memory per update.
    pub epochs: usize,
    /// Learning rate at the first step; decays linearly to 1e-10 over `total_steps`.
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
    /// Largest length of the gradient of an agent's loss by all of its parameters (Euclidean norm); a longer one is
    /// shortened to it. If left out, gradients are as long as they are.
    ///
    /// DEVIATION 22: one version of the authors' PPO has 0.5, another one has no limit. The paper names none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_gradient_norm: Option<f64>,
    /// Meaning of the end of an episode at the horizon for the return.
    pub time_limit: TimeLimit,
}

/// Meaning of the end of an episode at the horizon for the return.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeLimit {
    /// Nothing comes after it.
    #[default]
    Terminal,
    /// The end only cuts the recording: the value of the last observation replaces the rewards that would follow.
    ///
    /// DEVIATION 8: our configs choose it, because an agent sees no clock and cannot know that an end is near.
    Bootstrap,
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

/// Further files of a run besides its CSV files.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoggingConfig {
    /// Whether to write an event file for TensorBoard, with the numbers of the CSV files.
    pub tensorboard: bool,
}

/// Settings of a run's arithmetic.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NumericsConfig {
    /// Width of the vector registers that multiply matrices. `"widest"` is fastest. `"256-bit"` gives the same files on
    /// every x86-64 machine with AVX2 and FMA.
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
            gs: GsConfig::default(),
            policy: PolicyConfig::default(),
            imitation: ImitationConfig::default(),
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
            max_gradient_norm: None,
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
        self.simulator.predictor().unwrap_or_default()
    }

    /// Returns whether the loss of the influence predictors is measured. On the GS there are none.
    pub fn measures_aips(&self) -> bool {
        self.evaluation.aip_loss_episodes > 0 && self.simulator != Simulator::Global
    }

    /// Returns the number of steps of an episode of the config's domain.
    pub fn horizon(&self) -> usize {
        self.domain.as_ref().expect("a config that was loaded has a domain").horizon()
    }

    /// Returns the number of steps of an episode of what the policies train on: the GS (global simulator) or local ones.
    pub fn training_horizon(&self) -> usize {
        let domain = self.domain.as_ref().expect("a config that was loaded has a domain");
        if self.simulator == Simulator::Global { domain.horizon() } else { domain.local_horizon() }
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
