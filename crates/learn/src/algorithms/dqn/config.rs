//! The table `[dqn]`.

use anyhow::{Result, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::algorithms::ppo::TimeLimit;
use crate::config::Config;
use crate::config::check::{not_negative, positive, share};

/// DQN, as in Mnih et al. 2015. Every agent has a replay of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DqnConfig {
    /// Number of decisions that the replay of an agent holds. It is part of every checkpoint.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub replay: usize,
    /// Timesteps per agent before the first update.
    pub learning_starts: u64,
    /// Timesteps per agent between two updates; a multiple of `copies`.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub(crate) update_every_steps: usize,
    /// Number of gradient steps per update.
    #[schemars(range(min = 1, max = 10_000))]
    pub(crate) gradient_steps: usize,
    /// Number of samples per agent and gradient step.
    #[schemars(range(min = 1))]
    pub minibatch: usize,
    /// Learning rate.
    pub learning_rate: f64,
    /// Discount factor.
    pub gamma: f64,
    /// Timesteps per agent after which the target network becomes a copy of the network.
    #[schemars(range(min = 1))]
    pub(crate) target_every_steps: u64,
    /// Share of random actions at the first step. It falls linearly.
    pub(crate) epsilon: f64,
    /// Share of random actions in the end.
    pub(crate) final_epsilon: f64,
    /// Timesteps per agent over which the share of random actions falls.
    #[schemars(range(min = 1))]
    pub epsilon_steps: u64,
    /// Largest length of the gradient of an agent's loss (Euclidean norm); a longer one is shortened to it. If left
    /// out, there is no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) max_gradient_norm: Option<f64>,
    /// Whether the network chooses the next action, and the target network only values it (van Hasselt et al. 2016).
    pub double: bool,
    /// Whether the network has a value of the state and advantages of the actions (Wang et al. 2016).
    pub dueling: bool,
    /// Whether samples are drawn by their last error (Schaul et al. 2016) and not uniformly.
    pub prioritised: bool,
    /// Exponent of the error in a sample's priority, if `prioritised`.
    pub(crate) priority_exponent: f64,
    /// Exponent of the correction for drawing by priority; 1 corrects in full.
    pub(crate) importance_exponent: f64,
    /// Meaning of the end of an episode at the horizon for the return.
    pub(crate) time_limit: TimeLimit,
}

impl Default for DqnConfig {
    fn default() -> Self {
        DqnConfig {
            replay: 10_000,
            learning_starts: 1_000,
            update_every_steps: 16,
            gradient_steps: 2,
            minibatch: 32,
            learning_rate: 5e-4,
            gamma: 0.99,
            target_every_steps: 1_000,
            epsilon: 1.0,
            final_epsilon: 0.02,
            epsilon_steps: 20_000,
            max_gradient_norm: Some(10.0),
            double: true,
            dueling: true,
            prioritised: false,
            priority_exponent: 0.6,
            importance_exponent: 0.4,
            time_limit: TimeLimit::Terminal,
        }
    }
}

impl DqnConfig {
    pub(super) fn check(&self, config: &Config) -> Result<()> {
        ensure!(
            self.update_every_steps.is_multiple_of(config.copies()),
            "dqn.update_every_steps = {}: must be a multiple of {} = {}",
            self.update_every_steps,
            config.key_of_copies(),
            config.copies()
        );
        ensure!(
            self.minibatch as u64 <= self.learning_starts.min(self.replay as u64),
            "dqn.minibatch = {}: must not exceed dqn.learning_starts = {} and dqn.replay = {}",
            self.minibatch,
            self.learning_starts,
            self.replay
        );
        ensure!(
            self.replay.is_multiple_of(config.copies()),
            "dqn.replay = {}: must be a multiple of {} = {}",
            self.replay,
            config.key_of_copies(),
            config.copies()
        );
        positive("dqn.learning_rate", self.learning_rate, "5e-4 is the default")?;
        share("dqn.gamma", self.gamma, "0.99 is usual")?;
        share("dqn.epsilon", self.epsilon, "1 is the default")?;
        share("dqn.final_epsilon", self.final_epsilon, "0.02 is the default")?;
        not_negative("dqn.priority_exponent", self.priority_exponent, "0.6 is the default")?;
        share("dqn.importance_exponent", self.importance_exponent, "0.4 is the default")?;
        if let Some(norm) = self.max_gradient_norm {
            positive("dqn.max_gradient_norm", norm, "10 is the default; leave it out for no limit")?;
        }
        ensure!(
            config.policy.recurrent.is_none(),
            "policy.recurrent: algorithm = \"dqn\" learns from single decisions; remove the key, or use \"ppo\""
        );
        ensure!(
            config.policy.imitate.is_none(),
            "policy.imitate: algorithm = \"dqn\" has no policy that could imitate; remove the key, or use \"ppo\""
        );
        ensure!(
            !config.shares_policies(),
            "policy.share = \"kind\": is for algorithm = \"ppo\"; set policy.share = \"none\", or use \"ppo\""
        );
        Ok(())
    }
}
