//! The table `[ppo]`.

use anyhow::{Result, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::value_unit::ValueUnit;
use crate::config::Config;
use crate::config::check::{not_negative, positive, share};

/// PPO, as in Schulman et al. 2017.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PpoConfig {
    /// Number of steps of a rollout (T), after which advantages are estimated. Warehouse: 8.
    #[schemars(range(min = 1, max = 1_000_000), extend("source" = "P"))]
    pub rollout_steps: usize,
    /// Number of samples per agent and update; must be a multiple of `copies` x `rollout_steps`.
    #[schemars(range(min = 1, max = 1_000_000), extend("source" = "P"))]
    pub memory: usize,
    /// Number of samples per agent and gradient step; must divide `ppo.memory`.
    // The advantages of a minibatch are divided by their unbiased standard deviation.
    #[schemars(range(min = 2), extend("source" = "P"))]
    pub minibatch: usize,
    /// Number of passes over the memory per update.
    #[schemars(range(min = 1, max = 100_000), extend("source" = "P"))]
    pub epochs: usize,
    /// Learning rate at the first step.
    ///
    /// DEVIATION 25: our configs of grids and of the warehouse have 1e-3, and smaller networks.
    #[schemars(extend("source" = "P, C"))]
    pub learning_rate: f64,
    /// Whether the learning rate decays linearly over `total_steps`, to 1e-10.
    #[schemars(extend("source" = "C"))]
    pub anneal_learning_rate: bool,
    /// Adam's epsilon, from 1e-8. Usual is 1e-5.
    #[schemars(extend("source" = "C"))]
    pub adam_epsilon: f64,
    /// Discount factor.
    #[schemars(extend("source" = "P"))]
    pub gamma: f64,
    /// Lambda of the GAE.
    #[schemars(extend("source" = "P"))]
    pub gae_lambda: f64,
    /// Weight of the entropy bonus (beta).
    #[schemars(extend("source" = "P"))]
    pub entropy: f64,
    /// Clip range (epsilon) at the first step.
    #[schemars(extend("source" = "P, C"))]
    pub clip: f64,
    /// Whether the clip range decays linearly over `total_steps`, to 1e-5.
    #[schemars(extend("source" = "C"))]
    pub anneal_clip: bool,
    /// Whether the value is clipped, too: by `ppo.clip`, in `ppo.value_unit`.
    #[schemars(extend("source" = "C"))]
    pub clip_value: bool,
    /// Unit in which values are learnt, clipped and weighed.
    ///
    /// DEVIATION 24: the paper's is that of the reward. Then nothing is learnt until the critic has climbed to values of about
    /// 70, and the clip range lets it climb by 0.1 per update.
    pub value_unit: ValueUnit,
    /// Weight of the value loss (c1), which is the mean squared error. Half of the mean squared error with the usual
    /// weight of 0.5 is 0.25 here.
    #[schemars(extend("source" = "P"))]
    pub value_coefficient: f64,
    /// Which advantages get mean 0 and standard deviation 1 together.
    #[schemars(extend("source" = "C"))]
    pub normalise_advantages: NormaliseAdvantages,
    /// Largest length of the gradient of an agent's loss by all of its parameters (Euclidean norm); a longer one is
    /// shortened to it. If left out, gradients are as long as they are.
    ///
    /// DEVIATION 22: one version of the authors' PPO has 0.5, another one has no limit. The paper names none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_gradient_norm: Option<f64>,
    /// Meaning of the end of an episode at the horizon for the return.
    #[schemars(extend("source" = "C"))]
    pub time_limit: TimeLimit,
}

/// Meaning of the end of an episode at the horizon for the return.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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

/// Which advantages of an agent get mean 0 and standard deviation 1 together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NormaliseAdvantages {
    /// Those of a minibatch.
    #[default]
    Minibatch,
    /// Those of the whole memory.
    Memory,
    /// None: they are only brought to the unit of the value.
    No,
}

impl Default for PpoConfig {
    fn default() -> Self {
        PpoConfig {
            rollout_steps: 16,
            memory: 128,
            minibatch: 32,
            epochs: 3,
            learning_rate: 2.5e-4,
            anneal_learning_rate: true,
            adam_epsilon: 1e-8,
            gamma: 0.99,
            gae_lambda: 0.95,
            entropy: 1e-2,
            clip: 0.1,
            anneal_clip: true,
            clip_value: true,
            value_unit: ValueUnit::Reward,
            value_coefficient: 1.0,
            normalise_advantages: NormaliseAdvantages::Minibatch,
            max_gradient_norm: None,
            time_limit: TimeLimit::Terminal,
        }
    }
}

impl PpoConfig {
    /// Whether policy and value learn without each other where they have layers of their own: no limit on the length of the gradient
    /// joins them.
    pub fn towers_learn_alone(&self) -> bool {
        self.max_gradient_norm.is_none()
    }
}

/// Checks the table, and what depends on it.
pub(super) fn check(config: &Config) -> Result<()> {
    let ppo = &config.ppo;
    ensure!(
        ppo.memory.is_multiple_of(ppo.minibatch),
        "ppo.memory = {}: must be a multiple of ppo.minibatch = {}",
        ppo.memory,
        ppo.minibatch
    );
    let rollout = config.copies() * ppo.rollout_steps;
    ensure!(
        ppo.memory.is_multiple_of(rollout),
        "ppo.memory = {}: must be a multiple of {} x ppo.rollout_steps = {} x {} = {rollout}",
        ppo.memory,
        config.key_of_copies(),
        config.copies(),
        ppo.rollout_steps,
    );
    let length = config.sequence_length();
    ensure!(
        ppo.rollout_steps.is_multiple_of(length) && ppo.minibatch.is_multiple_of(length),
        "policy.sequence_length = {length}: must divide ppo.rollout_steps = {} and ppo.minibatch = {}",
        ppo.rollout_steps,
        ppo.minibatch
    );
    positive("ppo.learning_rate", ppo.learning_rate, "the paper uses 2.5e-4")?;
    share("ppo.gamma", ppo.gamma, "the paper uses 0.99")?;
    share("ppo.gae_lambda", ppo.gae_lambda, "the paper uses 0.95")?;
    not_negative("ppo.entropy", ppo.entropy, "the paper uses 0.01")?;
    positive("ppo.clip", ppo.clip, "the paper uses 0.1")?;
    ensure!(
        (1e-8..1.0).contains(&ppo.adam_epsilon),
        "ppo.adam_epsilon = {}: must be from 1e-8 to less than 1 (the paper's code has 1e-8, and 1e-5 is usual)",
        ppo.adam_epsilon
    );
    not_negative("ppo.value_coefficient", ppo.value_coefficient, "the paper uses 1")?;
    if let Some(norm) = ppo.max_gradient_norm {
        positive("ppo.max_gradient_norm", norm, "0.5 is usual; leave it out for no limit")?;
    }
    Ok(())
}
