//! Policies: actor and critic of all agents as one stack, how actions are drawn, and the memory they learn from.

mod controller;
mod memory;
pub mod sampling;

use std::path::Path;

use crate::base::{AgentId, Rows, Seed};
use crate::config::PolicyConfig;
use crate::domain::{RegionSpec, Result};
use crate::nn::{Net, Parameters, Sequences, Shape, States, Trace, write_script};

pub use controller::{JointPolicyController, Selection};
pub use memory::{Memory, Sample};

/// The parameters of all agents' policies, one row per agent: what is exchanged, saved and evaluated.
pub type JointPolicy = Rows<f32>;

/// One policy and value network per agent: observation -> GRU, if any -> hidden layers -> logits and one value.
///
/// Source: DIALS paper, appendix "Hyperparameters" (traffic: 256 and 128; warehouse: GRU 256 and 128).
pub struct PolicyStack {
    n_actions: usize,
    net: Net,
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

impl PolicyStack {
    /// What a policy looks like.
    pub fn shape(spec: &RegionSpec, config: &PolicyConfig) -> Shape {
        Shape {
            inputs: spec.obs_dim,
            recurrent: config.recurrent,
            hidden: config.hidden.clone(),
            outputs: spec.n_actions + 1,
        }
    }

    /// Randomly initialised policies, each agent's from its own stream; `action_bias` is added to the initial biases
    /// of the logits.
    pub fn new(agents: &[AgentId], spec: &RegionSpec, config: &PolicyConfig, action_bias: &[f32], seed: Seed) -> Self {
        let mut net = Net::new(agents, PolicyStack::shape(spec, config), seed);
        net.shift_output(action_bias);
        PolicyStack { n_actions: spec.n_actions, net }
    }

    /// Policies without values yet, for somebody who loads them.
    pub fn blank(agents: usize, spec: &RegionSpec, config: &PolicyConfig) -> Self {
        PolicyStack { n_actions: spec.n_actions, net: Net::blank(agents, PolicyStack::shape(spec, config)) }
    }

    pub fn agents(&self) -> usize {
        self.net.parameters().agents()
    }

    pub fn n_actions(&self) -> usize {
        self.n_actions
    }

    /// Cleared states for so many rows.
    pub fn states(&self, rows: usize) -> States {
        self.net.states(rows)
    }

    /// One decision. `obs`: rows ordered agent-major, one per row of `states`, which move on.
    pub fn judge(&self, obs: &Rows<f32>, states: &mut States) -> Judgement {
        Judgement { trace: self.net.step(obs, states), n_actions: self.n_actions }
    }

    /// Whole sequences of decisions. `obs`: rows ordered agent, step, sequence.
    pub fn judge_sequences(&self, obs: &Rows<f32>, sequences: &Sequences<'_>) -> Judgement {
        Judgement { trace: self.net.forward(obs, sequences), n_actions: self.n_actions }
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

    /// Writes the policies as a TorchScript module: `forward(obs)`, or `forward(obs, states)` for policies with a GRU,
    /// returns one table `[agents, batch, ..]` of the logits, the value and, with a GRU, the next state. `obs`: `[agents,
    /// batch, obs_dim]`, for any batch.
    pub fn write_script(&self, path: &Path) -> Result<()> {
        write_script(&self.net, path)
    }

    pub fn net_mut(&mut self) -> &mut Net {
        &mut self.net
    }
}
