//! The settings of learning: how agents learn, and when influence predictors are retrained and policies evaluated.
//!
//! Whoever reads them from a file adds the table of a domain. Defaults are the paper's for traffic (appendix
//! "Hyperparameters"); the files under `configs/` show where they differ.
//!
//! Every key is a field: its comment is its row in docs/configuration.md, its limits stand beside it, and what else must
//! hold for it is checked in the file of its table.
//!
//! - `simulator`: what the policies train on, and what predicts the influence there.
//! - `aip`; `imitation`, of a controller before PPO. The table of an algorithm is in its folder.
//! - `check`: the limits at the fields, and what holds between tables. `seed`: seeds in files.
//! - `schedule`: the periods of a run.

mod aip;
pub(crate) mod check;
mod imitation;
mod schedule;
mod seed;
mod simulator;

use check::{check_hidden, check_recurrent};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use crate::algorithms::AlgorithmName;
pub use crate::algorithms::dqn::DqnConfig;
pub use crate::algorithms::outside::OutsideConfig;
pub use crate::algorithms::ppo::{NormaliseAdvantages, PpoConfig, TimeLimit, ValueUnit};
pub use crate::predictors::Predictor;
use crate::state::stream::Part;
pub use aip::{AipConfig, Retrain};
pub use check::held_out_episodes;
pub use imitation::ImitationConfig;
pub use schedule::{AipTraining, Period, rest_of_schedule, schedule};
pub(crate) use simulator::{ROWS_PER_BLOCK, most_lanes};
pub use simulator::{ShortForm, Simulator, short_forms};

/// How agents learn, and when AIPs (approximate influence predictors) are retrained and policies evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Root of all random streams of the run, from 0 to 2^64 - 1.
    #[serde(with = "seed")]
    #[schemars(with = "u64")]
    pub seed: u64,
    /// What the policies train on; see [guide.md](guide.md#train).
    pub simulator: Simulator,
    /// What predicts the influence in local simulators. On the GS it is not read.
    pub predictor: Predictor,
    /// Timesteps per agent, summed over its copies. Learning rate and clip range decay over them.
    #[schemars(range(min = 1, max = 1_000_000_000_000_000_u64), extend("source" = "P"))]
    pub total_steps: u64,
    /// Timesteps per agent after which the run stops, at the next update of the policies. Learning rate and clip range
    /// still decay over `total_steps`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1))]
    pub stop_at_steps: Option<u64>,
    pub local_simulators: LocalSimulatorsConfig,
    pub gs: GsConfig,
    pub policy: PolicyConfig,
    pub imitation: ImitationConfig,
    /// Algorithm that trains the policies.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = AlgorithmName::default()))]
    pub algorithm: AlgorithmName,
    pub ppo: PpoConfig,
    #[serde(skip_serializing_if = "is_default")]
    pub dqn: DqnConfig,
    #[serde(skip_serializing_if = "is_default")]
    pub outside: OutsideConfig,
    pub aip: AipConfig,
    pub evaluation: EvaluationConfig,
    pub checkpoints: CheckpointsConfig,
}

/// An agent's local simulators.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LocalSimulatorsConfig {
    /// Number of local simulators per agent, in lockstep.
    ///
    /// DEVIATION 7: our configs have 2 for traffic and 16 for the warehouse.
    #[schemars(range(min = 1, max = 10_000), extend("source" = "P"))]
    pub copies: usize,
    /// Whether copies begin their episodes at different times. Our configs: true.
    pub stagger: bool,
}

/// Training on the GS. With another simulator no key of this table is read.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GsConfig {
    /// Number of copies of the GS, each with all agents. If left out, as many as `local_simulators.copies`. Workers share them. They begin
    /// at different times if `local_simulators.stagger` says so.
    ///
    /// DEVIATION 23: the paper has one, and so do configs/paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 256))]
    pub copies: Option<usize>,
    /// Where the agents of a kind share one policy (`policy.share = "kind"`): whose value stands for what would come after a
    /// rollout.
    ///
    /// DEVIATION 6: in the authors' code it is that of the last agent, for all of them. So do configs/paper.
    pub bootstrap: Bootstrap,
}

/// Whose value stands for what would come after a rollout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Bootstrap {
    /// Each agent's own.
    #[default]
    Own,
    /// That of the last agent of a kind, for all of them.
    Last,
}

/// The network of an agent's policy and value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PolicyConfig {
    /// Width of a GRU before the hidden layers. If left out, the policy has no memory. Warehouse: 256.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("source" = "P"))]
    pub recurrent: Option<usize>,
    /// Widths of the hidden layers, with ReLU. Warehouse: `[128]`.
    #[schemars(extend("source" = "P"))]
    pub hidden: Vec<usize>,
    /// Number of steps over which the gradient flows back through a GRU; must divide `ppo.rollout_steps` and
    /// `ppo.minibatch`.
    #[schemars(range(min = 1), extend("source" = "P"))]
    pub sequence_length: usize,
    /// [Controller](controllers.md), with parameters but without a `file`, that new policies imitate before PPO begins:
    /// see [guide.md](guide.md#begin-with-a-controller). If left out, policies begin at random.
    ///
    /// DEVIATION 14: the paper's policies begin at random. With this key they begin with what an engineer knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imitate: Option<String>,
    /// Trained policy from which new policies start, instead of at random: `"any-light"`, see [any light](any-light.md).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<String>,
    /// Whether the value has a network of its own, with the same GRU and hidden layers as the policy.
    ///
    /// DEVIATION 15: in the paper policy and value share all layers but the last. Our configs of the paper's grids choose it.
    pub separate_critic: bool,
    /// How the weights begin.
    #[schemars(extend("source" = "C"))]
    pub initialisation: Initialisation,
    /// Which agents have one policy. An update of the policy of a kind takes minibatches from the samples of all its agents.
    ///
    /// DEVIATION 6: in the authors' code one policy serves all agents of the GS, and in DIALS every agent has its own. Our configs
    /// of grids and of the warehouse share.
    #[schemars(extend("source" = "C"))]
    pub share: Share,
    /// Timesteps per agent after which all agents of a kind get the mean of their policies, and of their optimisers'
    /// moments. They also begin with one policy. If left out, they never do. Best a divisor of `evaluation.every_steps`,
    /// so that the mean is evaluated; 1024 did well. At most `total_steps`. It does not go
    /// with `policy.share = "kind"` or `policy.imitate`.
    ///
    /// DEVIATION 19: in the paper every agent keeps its own policy. With this key agents also learn from each other, and
    /// still train in parallel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub average_every_steps: Option<u64>,
}

/// Which agents have one policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Share {
    /// None: every agent learns for itself.
    #[default]
    None,
    /// All agents of a kind.
    Kind,
}

/// How the weights of a policy begin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Initialisation {
    /// Uniform, also the biases: as torch begins by itself.
    #[default]
    Uniform,
    /// Orthogonal, with a gain of 1.41 in hidden layers, 0.01 for the policy and 1 for the value; biases are 0.
    Orthogonal,
}

impl Default for PolicyConfig {
    fn default() -> Self {
        PolicyConfig {
            recurrent: None,
            hidden: vec![256, 128],
            sequence_length: 8,
            imitate: None,
            start: None,
            separate_critic: false,
            initialisation: Initialisation::Uniform,
            share: Share::None,
            average_every_steps: None,
        }
    }
}

impl PolicyConfig {
    fn check(&self) -> anyhow::Result<()> {
        check_hidden("policy.hidden", &self.hidden, 1)?;
        check_recurrent("policy.recurrent", self.recurrent)
    }
}

/// Evaluation of the joint policy on the GS. It leaves no trace in training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EvaluationConfig {
    /// Timesteps per agent between two evaluations; at least `ppo.memory`. There is also one at step 0 and one at the end.
    #[schemars(range(min = 1))]
    pub every_steps: u64,
    /// Root of the random streams of all evaluation episodes. Runs with the same value are evaluated on the same
    /// traffic, whatever their own seed. So their returns can be compared episode by episode.
    #[serde(with = "seed")]
    #[schemars(with = "u64")]
    pub seed: u64,
    /// Number of episodes per evaluation during training, the same ones each time. Warehouse: 100.
    #[schemars(range(min = 1, max = 100_000))]
    pub episodes: usize,
    /// Number of episodes of the evaluation at the end of training: the episodes above and further ones.
    #[schemars(range(min = 1, max = 100_000))]
    pub final_episodes: usize,
    /// Number of separate episodes, the same ones each time, on which every evaluation measures the loss of the AIPs; 0
    /// for none. `aip.retrain = "drift"` needs them. They take under 1 % of the time. Our configs: 4 for traffic, 20 for
    /// the warehouse.
    #[schemars(range(max = 100_000))]
    pub aip_loss_episodes: usize,
}

impl Default for EvaluationConfig {
    fn default() -> Self {
        EvaluationConfig { every_steps: 100_000, seed: 0, episodes: 20, final_episodes: 100, aip_loss_episodes: 0 }
    }
}

/// The checkpoints, from which a stopped run continues.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CheckpointsConfig {
    /// Longest wall time in minutes that policies are trained without a checkpoint; more than 0. At each one the simulators are
    /// made again, and play again what they had played of their episodes. Changes no number.
    pub(crate) every_minutes: f64,
    /// Timesteps per agent between further checkpoints, besides those at every evaluation, every training of the AIPs and
    /// every mean of the policies; at least `ppo.memory`. Changes no number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) every_steps: Option<u64>,
}

impl Default for CheckpointsConfig {
    fn default() -> Self {
        CheckpointsConfig { every_minutes: 5.0, every_steps: None }
    }
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
            algorithm: AlgorithmName::default(),
            ppo: PpoConfig::default(),
            dqn: DqnConfig::default(),
            outside: OutsideConfig::default(),
            aip: AipConfig::default(),
            evaluation: EvaluationConfig::default(),
            checkpoints: CheckpointsConfig::default(),
        }
    }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Default for LocalSimulatorsConfig {
    fn default() -> Self {
        LocalSimulatorsConfig { copies: 1, stagger: false }
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
        step.checked_next_multiple_of(crate::algorithms::of(self).steps_per_update() as u64).unwrap_or(u64::MAX)
    }

    /// Returns the timesteps per agent at the last update of the policies at or before a step.
    pub(crate) fn update_at_or_before(&self, step: u64) -> u64 {
        step - step % crate::algorithms::of(self).steps_per_update() as u64
    }

    /// Returns the number of simulators per agent that the policies train on. A GS has one region of each agent.
    pub fn copies(&self) -> usize {
        match (self.simulator, self.gs.copies) {
            (Simulator::Global, Some(copies)) => copies,
            _ => self.local_simulators.copies,
        }
    }

    /// Returns the rows of each lane in which this number of agents of a kind acts. Each copy of the GS is a lane. Local
    /// simulators are `lanes` of them, with all copies of some agents each, or fewer.
    pub(crate) fn parts(&self, agents: usize, lanes: usize) -> Vec<Part> {
        let copies = self.copies();
        let lanes = lanes.min(agents);
        match self.simulator {
            Simulator::Global => (0..copies).map(|copy| Part { agents: 0..agents, copies: copy..copy + 1 }).collect(),
            Simulator::Local => {
                let of_lane = |lane| agents * lane / lanes..agents * (lane + 1) / lanes;
                (0..lanes).map(|lane| Part { agents: of_lane(lane), copies: 0..copies }).collect()
            }
        }
    }

    /// Returns the key that says [`Config::copies`].
    pub(crate) fn key_of_copies(&self) -> &'static str {
        match (self.simulator, self.gs.copies) {
            (Simulator::Global, Some(_)) => "gs.copies",
            _ => "local_simulators.copies",
        }
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
        self.policy.share == Share::Kind
    }

    /// Returns whether all agents of a kind learn at one place: because they act in one GS, because they have one policy, or
    /// because a process outside of this program has the learner.
    pub fn learns_at_one_place(&self) -> bool {
        self.simulator == Simulator::Global || self.shares_policies() || self.learns_outside()
    }

    /// Returns whether the learner is in a process outside of this program.
    pub fn learns_outside(&self) -> bool {
        self.algorithm == AlgorithmName::Outside
    }

    /// Returns whether the influence predictor is in a process outside of this program.
    pub fn predicts_outside(&self) -> bool {
        self.predictor_in_use() == Some(Predictor::Outside)
    }

    /// Returns how many cores can be at work at most while this number of agents acts in training: one for each of them, for each
    /// copy of the GS, or for each lane of local simulators whose agents share a policy. `foreign`: whether simulators are
    /// processes of their own. Native ones of the GS, and of a shared policy, are all in one thread.
    pub fn most_at_work(&self, agents: usize, foreign: bool) -> usize {
        match self.simulator {
            _ if !foreign && self.learns_at_one_place() => 1,
            Simulator::Global => self.copies(),
            Simulator::Local if self.learns_outside() => 1,
            Simulator::Local if self.shares_policies() => most_lanes(agents * self.copies()),
            Simulator::Local => agents,
        }
    }

    /// Returns how many parts of a kind's policies can learn at the same time at one place: one for each of its agents, or, if they
    /// have one policy, for each of its towers that learns without the other.
    pub fn most_learners(&self, agents: usize) -> usize {
        match self.algorithm {
            AlgorithmName::Outside => 1,
            _ if !self.shares_policies() => agents,
            AlgorithmName::Ppo if self.policy.separate_critic && self.ppo.towers_learn_alone() => 2,
            _ => 1,
        }
    }

    /// Returns whether the value of the last agent of a kind stands for what would come for all of them.
    pub fn bootstraps_with_last(&self) -> bool {
        self.shares_policies() && self.simulator == Simulator::Global && self.gs.bootstrap == Bootstrap::Last
    }

    /// Returns the timesteps per agent at the beginning of training in which only the critic learns.
    pub fn critic_steps(&self) -> u64 {
        if self.policy.imitate.is_some() { self.imitation.critic_steps } else { 0 }
    }

    /// Returns the number of episodes of a dataset after step 0: at least two, because one is held out. No dataset is longer than
    /// the run, if what is left fills a batch: in a short trial on a large city, collecting would be nearly all of the work.
    pub fn dataset_episodes(&self, horizon: usize) -> usize {
        self.episodes_of_dataset(self.aip.dataset_steps, horizon)
    }

    /// Returns the number of episodes of the dataset at step 0, see [`Config::dataset_episodes`].
    pub fn first_dataset_episodes(&self, horizon: usize) -> usize {
        let AipConfig { dataset_steps, first_dataset_share, .. } = self.aip;
        self.episodes_of_dataset((dataset_steps as f64 * first_dataset_share).ceil() as usize, horizon)
    }

    fn episodes_of_dataset(&self, steps: usize, horizon: usize) -> usize {
        let run = usize::try_from(self.total_steps).unwrap_or(usize::MAX);
        let of = |steps: usize| steps.div_ceil(horizon).max(2);
        let (short, full) = (of(steps.min(run)), of(self.aip.dataset_steps));
        if aip::fill_a_batch(self, short, horizon) { short } else { full }
    }
}
