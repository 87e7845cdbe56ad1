//! What an agent learns from: the samples of one update.

use crate::base::Rows;
use crate::domain::Action;

/// One decision of one agent and what came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    pub action: Action,
    /// `ln pi(a | o)` and `V(o)` of the policy that acted.
    pub log_prob: f32,
    pub value: f32,
    /// The generalised advantage estimate and the return it implies, `advantage + value`.
    pub advantage: f32,
    pub ret: f32,
}

/// The samples of all agents between two updates, `capacity` per agent.
///
/// Rows are ordered agent, rollout, step, copy.
pub struct Memory {
    capacity: usize,
    obs: Rows<f32>,
    samples: Vec<Sample>,
}

impl Memory {
    pub fn new(agents: usize, capacity: usize, obs_dim: usize) -> Self {
        Memory {
            capacity,
            obs: Rows::new(agents * capacity, obs_dim),
            samples: vec![Sample::default(); agents * capacity],
        }
    }

    /// Samples per agent.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    pub fn obs(&self, agent: usize, slot: usize) -> &[f32] {
        self.obs.row(agent * self.capacity + slot)
    }

    pub fn sample(&self, agent: usize, slot: usize) -> &Sample {
        &self.samples[agent * self.capacity + slot]
    }

    pub fn sample_mut(&mut self, agent: usize, slot: usize) -> &mut Sample {
        &mut self.samples[agent * self.capacity + slot]
    }

    /// Writes down a decision; its advantage and return follow later.
    pub fn remember(&mut self, agent: usize, slot: usize, obs: &[f32], sample: Sample) {
        self.obs.row_mut(agent * self.capacity + slot).copy_from_slice(obs);
        *self.sample_mut(agent, slot) = sample;
    }
}
