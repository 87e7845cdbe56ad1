//! What a learning agent sees of a simulator: decisions, rewards and ends of episodes, row by row.

pub mod copies;
pub(crate) mod global;
pub mod ials;

use std::time::Duration;

use crate::state::stream::AgentStream;
use dials_core::base::{Phase, Rows, Stopwatch};
use dials_core::domain::{Action, Percept, RegionSpec, Result};

/// A simulator without end that policies act in: the GS or the influence-augmented local simulators (IALS). When an
/// episode ends, the next one begins.
///
/// Rows are ordered by agent, then by copy, in one table per kind of agents. An IALS has one kind, copies of the GS have all
/// kinds of the domain.
///
/// Rows that decide together are a *turn*. An IALS has one. Copies of the GS have one each, if the algorithm allows it: see
/// [`crate::config::Config::turns`]. Turns do not wait for each other.
pub trait Environment {
    fn turns(&self) -> usize {
        1
    }

    /// Returns how many turns may be at work at the same time.
    fn at_once(&self) -> usize {
        1
    }

    /// Returns what the rows of a turn show at its next decision, kind by kind.
    fn percepts(&self, turn: usize) -> &[Percept];

    /// Begins one decision in every row of a turn, kind by kind.
    fn begin(&mut self, turn: usize, actions: &[Vec<Action>], watch: &mut Stopwatch) -> Result<()>;

    /// Waits until a turn that has begun a decision has made it, and returns it.
    fn finish(&mut self, watch: &mut Stopwatch) -> Result<usize>;

    /// Returns what the last decision of a turn brought its rows, kind by kind.
    fn experiences(&self, turn: usize) -> &[Experience];

    /// Writes down how far the rows of each kind have come, so that another environment can continue from there.
    fn leave(&mut self, streams: &mut [&mut [AgentStream]]);
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
