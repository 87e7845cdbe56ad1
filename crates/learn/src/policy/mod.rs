//! Policies: actor and critic of all agents of a kind as one stack.
//!
//! - `controller`: policies that act, in evaluation and in the collection of datasets.
//! - `demonstrations`: what a controller did, to be imitated.

mod controller;
mod demonstrations;

use std::f32::consts::SQRT_2;
use std::ops::Range;

use crate::config::{Initialisation, PolicyConfig};
use dials_core::base::{AgentId, Ragged, Rows, Seed};
use dials_core::domain::sampling;
use dials_core::domain::{Percept, RegionSpec};
use stacknets::{Adam, Gains, Parameters, Shape, Stack, States, Threads, Trainer};

pub use controller::{JointPolicyController, StackController};
pub use demonstrations::Demonstrations;
pub use dials_core::domain::sampling::Selection;

/// Parameters of all agents' policies, one row per agent, as wide as its kind has it. They are exchanged, saved and
/// evaluated.
pub type JointPolicy = Ragged<f32>;

/// One policy and value network per agent: observation -> GRU, if any -> hidden layers -> logits and one value; or a
/// network over sets, if the observation is one. The
/// critic, which gives the value, can have a GRU and hidden layers of its own (`policy.separate_critic`).
///
/// Source: DIALS paper, appendix "Hyperparameters" (traffic: 256 and 128; warehouse: GRU 256 and 128).
pub struct PolicyStack {
    n_actions: usize,
    pub(crate) net: Stack,
    reading: Reading,
}

/// How decisions are read from the outputs of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// The outputs are logits of probabilities.
    Probabilities,
    /// The best action is certain: outputs are values of actions, up to a number that is the same for all.
    Greedy,
}

/// Outputs of the networks for a batch of observations, one row per observation.
pub struct Judgement {
    /// `[rows, n_actions + 1]`
    outputs: Rows<f32>,
}

impl Judgement {
    /// Returns the logits of the actions and the value, row by row.
    ///
    /// Actions that are not allowed have the logit minus infinity.
    pub fn rows(&self) -> impl Iterator<Item = (&[f32], f32)> {
        let n_actions = self.outputs.width() - 1;
        self.outputs.iter().map(move |row| (&row[..n_actions], row[n_actions]))
    }
}

impl PolicyStack {
    pub fn shape(spec: &RegionSpec, config: &PolicyConfig) -> Shape {
        if let Some(sets) = spec.sets {
            return Shape::over_sets(sets, config.hidden.clone());
        }
        Shape {
            sets: None,
            inputs: spec.obs_dim,
            recurrent: config.recurrent,
            hidden: config.hidden.clone(),
            outputs: spec.n_actions + 1,
            apart: usize::from(config.separate_critic),
        }
    }

    /// Makes policies with random parameters, each agent's from its own stream. `action_bias` is added to the initial
    /// biases of the logits.
    pub fn new(agents: &[AgentId], spec: &RegionSpec, config: &PolicyConfig, action_bias: &[f32], seed: Seed) -> Self {
        let (shape, generators) = (PolicyStack::shape(spec, config), seed.for_agents(agents));
        let mut net = match config.initialisation {
            Initialisation::Uniform => Stack::new(shape, generators),
            Initialisation::Orthogonal => {
                let outputs = [vec![0.01; spec.n_actions], vec![1.0]].concat();
                Stack::orthogonal(shape, &Gains { hidden: SQRT_2, outputs }, generators)
            }
        };
        net.shift_output(action_bias);
        PolicyStack { n_actions: spec.n_actions, net, reading: Reading::Probabilities }
    }

    /// Makes policies whose parameters are still to be loaded.
    pub fn blank(agents: usize, spec: &RegionSpec, config: &PolicyConfig) -> Self {
        let net = Stack::blank(agents, PolicyStack::shape(spec, config));
        PolicyStack { n_actions: spec.n_actions, net, reading: Reading::Probabilities }
    }

    pub(crate) fn read_as(mut self, reading: Reading) -> Self {
        self.reading = reading;
        self
    }

    pub(crate) fn agents(&self) -> usize {
        self.net.parameters().networks()
    }

    pub(crate) fn n_actions(&self) -> usize {
        self.n_actions
    }

    /// Returns the width of the hidden state; 0 without memory.
    pub fn state_width(&self) -> usize {
        self.net.shape().state_width()
    }

    /// Returns which parameters are the critic's alone, one flag per parameter of an agent.
    pub(crate) fn only_critic(&self) -> Vec<bool> {
        self.net.shape().only_for_the_last_output()
    }

    pub fn states(&self, rows: usize) -> States {
        self.net.states(rows)
    }

    /// Runs one decision of some agents in these threads. `obs`: rows ordered by agent, then by copy, one per row of `states`,
    /// which are updated.
    pub fn judge(&self, agents: Range<usize>, threads: &Threads, obs: &Rows<f32>, states: &mut States) -> Judgement {
        Judgement { outputs: self.net.step_of(agents, threads, obs, states) }
    }

    /// Runs one decision of some agents on what a percept shows, in these threads. Only the actions that it allows count.
    pub(crate) fn decide(
        &self,
        agents: Range<usize>,
        threads: &Threads,
        percept: &Percept,
        states: &mut States,
    ) -> Judgement {
        let mut judgement = self.judge(agents, threads, &percept.obs, states);
        for (row, outputs) in judgement.outputs.as_mut_slice().chunks_exact_mut(self.n_actions + 1).enumerate() {
            let logits = &mut outputs[..self.n_actions];
            sampling::forbid(logits, percept.masks.as_ref().map_or(&[], |masks| masks.row(row)));
            if self.reading == Reading::Greedy {
                sampling::make_certain(logits);
            }
        }
        judgement
    }

    pub fn parameters(&self) -> &Parameters {
        self.net.parameters()
    }

    pub fn load(&mut self, policies: &Rows<f32>) {
        self.net.parameters_mut().load(policies);
    }

    /// Returns every agent's policy with its part of the optimiser, for `steps` gradient steps each.
    pub fn learners<'a>(&'a mut self, adam: &'a mut Adam, steps: u32) -> Vec<Trainer<'a>> {
        adam.trainers(&mut self.net, steps)
    }
}
