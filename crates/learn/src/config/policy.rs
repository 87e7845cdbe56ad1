//! The table `[policy]`.

use anyhow::Result;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{check_hidden, check_recurrent};

/// The network of an agent's policy and value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PolicyConfig {
    /// Width of a GRU before the hidden layers. If left out, the policy has no memory. Warehouse: 256.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("source" = "P"))]
    pub recurrent: Option<usize>,
    /// Widths of the hidden layers, with ReLU. Warehouse: [128].
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
    /// Whether the value has a network of its own, with the same GRU and hidden layers as the policy.
    ///
    /// DEVIATION 15: in the paper policy and value share all layers but the last. Then the value's large errors change
    /// the layers that the policy needs. Our configs of the paper's grids choose it.
    pub separate_critic: bool,
    /// Timesteps per agent after which all agents of a kind get the mean of their policies, and of their optimisers'
    /// moments. They also begin with one policy. If left out, they never do. Best a divisor of `evaluation.every_steps`,
    /// so that the mean is evaluated; 10 000 did well, with a learning rate of 2e-3. At most `total_steps`. It does not go
    /// with `gs.shared_policy` or `policy.imitate`.
    ///
    /// DEVIATION 19: in the paper every agent keeps its own policy. With this key agents also learn from each other, and
    /// still train in parallel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub average_every_steps: Option<u64>,
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

impl PolicyConfig {
    pub(super) fn check(&self) -> Result<()> {
        check_hidden("policy.hidden", &self.hidden, 1)?;
        check_recurrent("policy.recurrent", self.recurrent)
    }
}
