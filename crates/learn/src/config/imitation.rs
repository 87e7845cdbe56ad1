//! The imitation of a hand-coded controller before PPO.

use anyhow::{Result, bail, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Config;
use super::check::{check_batch, inner_share, positive, share};

/// The imitation, if `policy.imitate` names a controller. Otherwise no key of this table is read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImitationConfig {
    /// Number of GS (global simulator) steps that the controller plays, rounded up to whole episodes.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub dataset_steps: usize,
    /// Share of the decisions in which a random action is carried out instead of the controller's. So policies also
    /// learn what the controller does where it would not have come by itself, and where small errors lead them. `actuated`
    /// and `program` never slip.
    pub(crate) slips: f64,
    /// Share of the episodes, the last ones, that only measure the imitation.
    pub(crate) held_out: f64,
    /// Number of passes over the dataset.
    #[schemars(range(min = 1, max = 100_000))]
    pub epochs: usize,
    /// Number of samples per agent and gradient step; with a GRU, of whole episodes.
    #[schemars(range(min = 1))]
    pub minibatch: usize,
    /// Learning rate of the imitation, and of the critic as long as it learns alone.
    pub learning_rate: f64,
    /// Timesteps per agent at the beginning of training in which only the critic learns, and its loss is not clipped;
    /// fewer than `total_steps`.
    pub critic_steps: u64,
}

impl Default for ImitationConfig {
    fn default() -> Self {
        ImitationConfig {
            dataset_steps: 30_000,
            slips: 0.05,
            held_out: 0.1,
            epochs: 10,
            minibatch: 128,
            learning_rate: 1e-3,
            critic_steps: 20_000,
        }
    }
}

impl ImitationConfig {
    /// Returns the number of episodes that the controller plays.
    pub fn episodes(&self, horizon: usize) -> usize {
        self.dataset_steps.div_ceil(horizon)
    }
}

/// Checks what does not depend on the domain. The name of the controller is checked where the domain is known.
pub(super) fn check(config: &Config) -> Result<()> {
    let imitation = &config.imitation;
    share("imitation.slips", imitation.slips, "0.05 is the default")?;
    positive("imitation.learning_rate", imitation.learning_rate, "1e-3 is the default")?;
    inner_share("imitation.held_out", imitation.held_out)?;
    if let Some(name) = &config.policy.imitate {
        ensure!(
            config.policy.start.is_none(),
            "policy.imitate = \"{name}\": does not go with policy.start; remove one of the two keys"
        );
        ensure!(
            !name.contains(":file=") && !name.contains(",file="),
            "policy.imitate = \"{name}\": a run does not keep this file, so it could not be repeated; write what is in \
             it as parameters, such as \"coordinated:vertical=10,horizontal=8,offsets=0-12-12-0,early=3,late=2\""
        );
        ensure!(
            imitation.critic_steps < config.total_steps,
            "imitation.critic_steps = {}: must be less than total_steps = {}, because only the critic learns until then",
            imitation.critic_steps,
            config.total_steps
        );
        if let Some(every) = config.policy.average_every_steps {
            bail!(
                "policy.imitate = \"{name}\": agents imitate each on their own, so it does not go with \
                 policy.average_every_steps = {every}; remove one of the two keys"
            );
        }
    }
    Ok(())
}

/// Checks that the episodes suffice for a minibatch, if a controller is imitated.
pub(super) fn check_episodes(config: &Config, horizon: usize) -> Result<()> {
    if config.policy.imitate.is_none() {
        return Ok(());
    }
    let imitation = &config.imitation;
    let episodes = imitation.episodes(horizon);
    ensure!(
        episodes >= 2,
        "imitation.dataset_steps = {}: must span at least 2 episodes of {horizon} steps, one to train on and one held \
         out",
        imitation.dataset_steps
    );
    let by_episode = config.policy.recurrent.is_some();
    let size = (episodes, horizon);
    check_batch("imitation.minibatch", imitation.minibatch, size, imitation.held_out, by_episode, "the dataset")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(keys: &str) -> String {
        let config: Config = toml::from_str(keys).unwrap();
        let checked = config.check().and_then(|()| config.check_datasets(100));
        checked.map_or_else(|error| error.to_string(), |()| String::new())
    }

    #[test]
    fn an_imitation_that_makes_no_sense_is_refused_with_its_key() {
        for (keys, message) in [
            ("imitation.epochs = 0", "imitation.epochs = 0: must be at least 1"),
            ("imitation.minibatch = 0", "imitation.minibatch = 0: must be at least 1"),
            ("imitation.dataset_steps = 90000000", "imitation.dataset_steps = 90000000: must be at most 10000000"),
            ("imitation.slips = 1.5", "imitation.slips = 1.5: must be between 0 and 1"),
            ("imitation.held_out = 1.0", "imitation.held_out = 1: must be between 0 and 1"),
            ("imitation.learning_rate = nan", "imitation.learning_rate = NaN: must be a positive number"),
        ] {
            assert!(error(keys).contains(message), "{}", error(keys));
        }
        // Only if a controller is imitated. Episodes have 100 steps.
        for (keys, message) in [
            ("imitation.dataset_steps = 100", "must span at least 2 episodes of 100 steps"),
            (
                "imitation.dataset_steps = 200\nimitation.minibatch = 101",
                "imitation.minibatch = 101: must not exceed the 100 training samples",
            ),
            (
                "policy.recurrent = 8\nimitation.dataset_steps = 500",
                "imitation.minibatch = 128: must not exceed the 4 training episodes",
            ),
            (
                "total_steps = 10_000\nimitation.critic_steps = 10_000",
                "imitation.critic_steps = 10000: must be less than total_steps = 10000",
            ),
            ("policy.average_every_steps = 10_000", "does not go with policy.average_every_steps = 10000; remove one"),
        ] {
            assert_eq!(error(keys), "");
            let found = error(&format!("{keys}\npolicy.imitate = 'random'"));
            assert!(found.contains(message), "{found}");
        }
        assert!(error("policy.imitate = 'fixed-time:file=plan.toml'").contains("a run does not keep this file"));
    }
}
