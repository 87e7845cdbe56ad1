//! The table `[evaluation]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::seed;

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
