//! What a learning agent sees of a simulator: decisions, rewards and ends of episodes, row by row.

use super::stream::AgentStream;
use crate::base::{Rows, Stopwatch};
use crate::domain::{Action, Percept, RegionSpec, Result};

/// The GS, or an IALS: something that policies act in for as long as they like. Episodes that end begin again.
///
/// Rows are ordered agent-major, `copies` of each agent, and lie in one table per kind of agents: an IALS has one kind, the
/// GS all those of the domain.
pub trait Environment {
    /// What the rows of each kind show at the decision that is due.
    fn percepts(&self) -> &[Percept];

    /// One decision of every row of every kind; returns what it brought the rows of each kind.
    fn step(&mut self, actions: &[Vec<Action>], watch: &mut Stopwatch) -> Result<&[Experience]>;

    /// Writes down how far the rows of each kind have come, so that another environment can go on from there.
    fn leave(&mut self, streams: &mut [&mut [AgentStream]]);
}

/// What one decision of every row brought.
#[derive(Clone, Debug)]
pub struct Experience {
    /// `[rows]`
    pub rewards: Vec<f32>,
    /// `[rows]`: the episode of the row ended with this step; [`Environment::percepts`] already show the next one.
    pub ends: Vec<bool>,
    /// `[rows, obs_dim]`: the observation after the step, before the next episode begins. Written only where a row of
    /// `ends` is set.
    pub last_obs: Rows<f32>,
}

impl Experience {
    pub(super) fn new(rows: usize, spec: &RegionSpec) -> Self {
        Experience { rewards: vec![0.0; rows], ends: vec![false; rows], last_obs: Rows::new(rows, spec.obs_dim) }
    }

    pub fn any_end(&self) -> bool {
        self.ends.contains(&true)
    }
}
