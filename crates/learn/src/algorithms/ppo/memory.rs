//! The memory of an agent: the samples of one update, in sequences.

use crate::state::stream::Part;
use dials_core::base::Rows;
use dials_core::domain::{Action, RegionSpec};
use stacknets::States;

/// One decision of one agent and its result.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    pub action: Action,
    /// `ln pi(a | o)` and `V(o)` of the policy that acted.
    pub log_prob: f32,
    pub value: f32,
    /// What the network said for this value: it is in the unit that the critic had then.
    pub output: f32,
    /// Generalised advantage estimate, and the return that it implies, `advantage + value`.
    pub advantage: f32,
    pub ret: f32,
    /// Whether an episode begins with this decision.
    pub start: bool,
}

/// Samples of all agents between two updates, `capacity` per agent. They form sequences of `length` consecutive
/// decisions (1 for policies without memory), each with the hidden state in which it began.
///
/// Rows are ordered by agent, then by sequence, then by step.
pub struct Memory {
    /// Number of samples per agent.
    pub(super) capacity: usize,
    /// Number of steps per sequence.
    pub(super) length: usize,
    obs: Rows<f32>,
    /// Actions that were allowed; `None` if the kind has no masks.
    masks: Option<Rows<bool>>,
    samples: Vec<Sample>,
    states: States,
}

impl Memory {
    /// Makes an empty memory. `spec`: that of the agents' kind.
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

    /// Returns the number of sequences per agent; sequence s has the slots from `s * length` on.
    pub(crate) fn sequences(&self) -> usize {
        self.capacity / self.length
    }

    pub(crate) fn obs(&self, agent: usize, slot: usize) -> &[f32] {
        self.obs.row(agent * self.capacity + slot)
    }

    /// Returns the actions that were allowed; empty if all always are.
    pub(crate) fn mask(&self, agent: usize, slot: usize) -> &[bool] {
        self.masks.as_ref().map_or(&[], |masks| masks.row(agent * self.capacity + slot))
    }

    pub(crate) fn sample(&self, agent: usize, slot: usize) -> &Sample {
        &self.samples[agent * self.capacity + slot]
    }

    pub(crate) fn sample_mut(&mut self, agent: usize, slot: usize) -> &mut Sample {
        &mut self.samples[agent * self.capacity + slot]
    }

    /// Returns all samples of an agent.
    pub(super) fn samples(&self, agent: usize) -> &[Sample] {
        &self.samples[agent * self.capacity..][..self.capacity]
    }

    pub(crate) fn state(&self, agent: usize, sequence: usize) -> &[f32] {
        self.states.row(agent * self.sequences() + sequence)
    }

    /// Copies the samples of a rollout: all of `from`, whose agents and copies are a part of those here. The rollout is the
    /// `number`-th of this memory, in which all copies of an agent have theirs one after the other.
    pub(super) fn take_rollout(&mut self, number: usize, part: &Part, copies: usize, from: &Memory) {
        let steps = from.capacity / part.copies.len();
        for (agent, all) in part.agents.clone().enumerate() {
            for (copy, among_all) in part.copies.clone().enumerate() {
                let first = (number * copies + among_all) * steps;
                for t in 0..steps {
                    let slot = copy * steps + t;
                    let seen = (from.obs(agent, slot), from.mask(agent, slot));
                    let state = from.state(agent, slot / self.length);
                    self.remember(all, first + t, seen, state, *from.sample(agent, slot));
                }
            }
        }
    }

    /// Records a decision and, if a sequence begins with it, the hidden state before it. Its advantage and return
    /// follow later. `seen`: the observation, and the actions that were allowed, or empty.
    pub fn remember(&mut self, agent: usize, slot: usize, seen: (&[f32], &[bool]), state: &[f32], sample: Sample) {
        self.obs.row_mut(agent * self.capacity + slot).copy_from_slice(seen.0);
        if let Some(masks) = &mut self.masks {
            masks.row_mut(agent * self.capacity + slot).copy_from_slice(seen.1);
        }
        if slot.is_multiple_of(self.length) {
            self.states.set_row(agent * self.sequences() + slot / self.length, state);
        }
        *self.sample_mut(agent, slot) = sample;
    }
}
