//! Policies: actor and critic of all agents as one stack, how actions are drawn, and the memory they learn from.

mod controller;
mod memory;
pub mod sampling;

use crate::base::{AgentId, Rows, Seed};
use crate::domain::RegionSpec;
use crate::nn::{Layout, Mlp, Parameters, Trace, rows_to_tensor};

pub use controller::{JointPolicyController, Selection};
pub use memory::{Memory, Sample};

/// The parameters of all agents' policies, one row per agent: what is exchanged, saved and evaluated.
pub type JointPolicy = Rows<f32>;

/// One policy and value network per agent: observation -> hidden layers -> logits of the actions and one value.
///
/// Source: DIALS paper, appendix "Hyperparameters" (traffic: 256 and 128, ReLU).
pub struct PolicyStack {
    agents: usize,
    n_actions: usize,
    net: Mlp,
}

/// What the networks say about a batch of observations, rows as the observations.
pub struct Judgement {
    trace: Trace,
    n_actions: usize,
}

impl Judgement {
    /// Logits of the actions and the value, row by row.
    pub fn rows(&self) -> impl Iterator<Item = (&[f32], f32)> {
        self.trace.output().chunks_exact(self.n_actions + 1).map(|row| (&row[..self.n_actions], row[self.n_actions]))
    }

    pub fn trace(&self) -> &Trace {
        &self.trace
    }
}

fn sizes(spec: &RegionSpec, hidden: &[usize]) -> Vec<usize> {
    [&[spec.obs_dim], hidden, &[spec.n_actions + 1]].concat()
}

impl PolicyStack {
    /// Where the weights and biases of a policy lie within its row.
    pub fn layout(spec: &RegionSpec, hidden: &[usize]) -> Layout {
        Mlp::layout(&sizes(spec, hidden))
    }

    /// Randomly initialised policies, each agent's from its own stream; `action_bias` is added to the initial biases
    /// of the logits.
    pub fn new(agents: &[AgentId], spec: &RegionSpec, hidden: &[usize], action_bias: &[f32], seed: Seed) -> Self {
        let mut net = Mlp::new(agents, &sizes(spec, hidden), seed);
        net.shift_output(action_bias);
        PolicyStack { agents: agents.len(), n_actions: spec.n_actions, net }
    }

    pub fn agents(&self) -> usize {
        self.agents
    }

    pub fn n_actions(&self) -> usize {
        self.n_actions
    }

    /// `obs`: rows ordered agent-major, as many for each agent.
    pub fn judge(&self, obs: &Rows<f32>) -> Judgement {
        Judgement { trace: self.net.forward(rows_to_tensor(obs, self.agents)), n_actions: self.n_actions }
    }

    pub fn parameters(&self) -> &Parameters {
        self.net.parameters()
    }

    pub fn joint_policy(&self) -> JointPolicy {
        self.net.parameters().to_rows()
    }

    pub fn load(&mut self, policies: &JointPolicy) {
        self.net.parameters_mut().load(policies);
    }

    pub fn net_mut(&mut self) -> &mut Mlp {
        &mut self.net
    }
}
