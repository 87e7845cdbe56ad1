//! The table `[outside]`.

use anyhow::ensure;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::Config;
use dials_core::domain::Result;

/// A learner that is written in Python. `dials_traffic.dials` chooses it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OutsideConfig {
    /// Timesteps per agent between two calls of the learner's `learn`; must be a multiple of the number of copies.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub update_every_steps: usize,
}

impl Default for OutsideConfig {
    fn default() -> Self {
        OutsideConfig { update_every_steps: 128 }
    }
}

impl OutsideConfig {
    pub(super) fn check(&self, config: &Config) -> Result<()> {
        ensure!(
            self.update_every_steps.is_multiple_of(config.copies()),
            "outside.update_every_steps = {}: must be a multiple of {} = {}",
            self.update_every_steps,
            config.key_of_copies(),
            config.copies()
        );
        ensure!(
            config.policy.imitate.is_none(),
            "policy.imitate: algorithm = \"outside\" has its policies in Python; remove the key, or use \"ppo\""
        );
        ensure!(
            config.policy.average_every_steps.is_none(),
            "policy.average_every_steps: algorithm = \"outside\" has its policies in Python; remove the key, or use \"ppo\""
        );
        Ok(())
    }
}
