//! What an agent learns from: the samples of one update, in sequences.

use crate::base::Rows;
use crate::domain::{Action, RegionSpec};
use crate::nn::States;

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
    /// An episode begins with this decision.
    pub start: bool,
}

/// The samples of all agents between two updates, `capacity` per agent, in sequences of `length` consecutive decisions
/// (1 for policies without memory), each with the hidden state that it began in.
///
/// Rows are ordered agent, sequence, step.
pub struct Memory {
    capacity: usize,
    length: usize,
    obs: Rows<f32>,
    /// The actions that were allowed; `None` if the kind has no masks.
    masks: Option<Rows<bool>>,
    samples: Vec<Sample>,
    states: States,
}

impl Memory {
    /// `spec`: of the agents' kind.
    pub fn new(agents: usize, capacity: usize, length: usize, spec: &RegionSpec, state_width: usize) -> Self {
        Memory {
            capacity,
            length,
            obs: Rows::new(agents * capacity, spec.obs_dim),
            masks: spec.masks.then(|| Rows::new(agents * capacity, spec.n_actions)),
            samples: vec![Sample::default(); agents * capacity],
            states: States::new(agents * capacity / length, state_width),
        }
    }

    /// Samples per agent.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Steps per sequence.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Sequences per agent; sequence s has the slots from `s * length` on.
    pub fn sequences(&self) -> usize {
        self.capacity / self.length
    }

    pub fn obs(&self, agent: usize, slot: usize) -> &[f32] {
        self.obs.row(agent * self.capacity + slot)
    }

    /// The actions that were allowed, or nothing where all always are.
    pub fn mask(&self, agent: usize, slot: usize) -> &[bool] {
        self.masks.as_ref().map_or(&[], |masks| masks.row(agent * self.capacity + slot))
    }

    pub fn sample(&self, agent: usize, slot: usize) -> &Sample {
        &self.samples[agent * self.capacity + slot]
    }

    pub fn sample_mut(&mut self, agent: usize, slot: usize) -> &mut Sample {
        &mut self.samples[agent * self.capacity + slot]
    }

    /// The hidden state in which a sequence began.
    pub fn state(&self, agent: usize, sequence: usize) -> &[f32] {
        self.states.row(agent * self.sequences() + sequence)
    }

    /// Writes down which actions a decision was made from.
    pub fn remember_mask(&mut self, agent: usize, slot: usize, mask: &[bool]) {
        if let Some(masks) = &mut self.masks {
            masks.row_mut(agent * self.capacity + slot).copy_from_slice(mask);
        }
    }

    /// Writes down a decision and, where a sequence begins with it, the hidden state before it; its advantage and
    /// return follow later.
    pub fn remember(&mut self, agent: usize, slot: usize, obs: &[f32], state: &[f32], sample: Sample) {
        self.obs.row_mut(agent * self.capacity + slot).copy_from_slice(obs);
        if slot.is_multiple_of(self.length) {
            self.states.set_row(agent * self.sequences() + slot / self.length, state);
        }
        *self.sample_mut(agent, slot) = sample;
    }
}
