//! What a learning agent sees of a simulator: decisions, rewards and ends of episodes, row by row.
//!
//! - `global`: a copy of the GS. [`ials`]: local simulators with their influence. [`makers`]: who makes both.
//! - `lanes`: environments that are played side by side.

pub(crate) mod global;
pub mod ials;
pub(crate) mod lanes;
pub mod makers;

use std::time::Duration;

use crate::state::stream::AgentStream;
use dials_core::base::{Phase, Rows, Stopwatch};
use dials_core::domain::{Action, Percept, RegionSpec, Result};

/// A simulator without end that policies act in: a copy of the GS, or influence-augmented local simulators (IALS). When
/// an episode ends, the next one begins.
///
/// Rows are ordered by agent, then by copy, in one table per kind of agents. An IALS has one kind, a GS has all kinds of the
/// domain.
pub trait Environment {
    /// Returns what the rows show at their next decision, kind by kind.
    fn percepts(&self) -> &[Percept];

    /// Makes one decision in every row, kind by kind.
    fn step(&mut self, actions: &[Vec<Action>], watch: &mut Stopwatch) -> Result<()>;

    /// Returns what the last decision brought the rows, kind by kind.
    fn experiences(&self) -> &[Experience];

    /// Writes down how far its rows have come, so that another environment can continue from there. `streams`: all agents of
    /// each kind.
    fn leave(&mut self, streams: &mut [&mut [AgentStream]]);

    /// Returns what its simulators counted since it was made.
    fn counters(&self) -> Vec<(String, u64)> {
        Vec::new()
    }
}

/// Adds the time of a simulator's steps. Of it, `own` is what the simulator itself has measured, see
/// [`LocalSimulator::take_watch`](dials_core::domain::LocalSimulator::take_watch); the rest is its own step.
pub(crate) fn add_steps(watch: &mut Stopwatch, own: &Stopwatch, steps: Duration) {
    watch.add(own);
    watch.note(Phase::SimulatorStep, steps.saturating_sub(own.total()));
}

/// Result of one decision in every row.
#[derive(Clone, Debug)]
pub struct Experience {
    /// `[rows]`
    pub rewards: Vec<f32>,
    /// `[rows]`: whether the row's episode ended with this step. [`Environment::percepts`] already show the next one.
    pub ends: Vec<bool>,
    /// `[rows, obs_dim]`: the observation after the step, before the next episode begins. Written only for rows whose
    /// `ends` is set.
    pub last_obs: Rows<f32>,
    /// `[rows, n_actions]`: the actions that were allowed then, written for the same rows. `None` if the kind has no
    /// masks.
    pub last_masks: Option<Rows<bool>>,
}

impl Experience {
    pub(crate) fn new(rows: usize, spec: &RegionSpec) -> Self {
        Experience {
            rewards: vec![0.0; rows],
            ends: vec![false; rows],
            last_obs: Rows::new(rows, spec.obs_dim),
            last_masks: spec.masks.then(|| Rows::new(rows, spec.n_actions)),
        }
    }
}
