//! The dataset `D_i` of one agent.

use serde::{Deserialize, Serialize};

use dials_core::base::{AgentId, CompactRows, Rows};
use dials_core::domain::{Kinds, RegionSpec};

/// Pairs `(l_t, u_t)` of one agent in the order in which the GS made them: whole episodes, one after another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dataset {
    /// `[samples, d_set_dim]`
    pub d_sets: CompactRows,
    /// `[samples, sources]`
    pub sources: Rows<u8>,
    /// Number of samples per episode.
    pub(crate) horizon: usize,
    /// Number of sources that the agent has itself. The others only fill up the shape of its kind and are always 0.
    pub own_sources: usize,
}

impl Dataset {
    pub fn new(spec: &RegionSpec) -> Self {
        Dataset {
            d_sets: CompactRows::new(spec.d_set_dim),
            sources: Rows::new(0, spec.sources.count()),
            horizon: spec.horizon,
            own_sources: spec.sources.count(),
        }
    }

    /// Makes empty datasets, one per agent.
    pub fn of_all(kinds: &Kinds) -> Vec<Dataset> {
        let of_agent = |(agent, spec)| Dataset { own_sources: kinds.sources(agent), ..Dataset::new(spec) };
        AgentId::all(kinds.agents()).into_iter().zip(kinds.specs()).map(of_agent).collect()
    }

    /// Leaves out the values of sources that the agent does not have. `of_sources`: one value per source of its kind.
    pub(crate) fn only_own<T>(&self, mut of_sources: Vec<T>) -> Vec<T> {
        of_sources.truncate(self.own_sources);
        of_sources
    }

    pub fn len(&self) -> usize {
        self.d_sets.len()
    }

    pub fn episodes(&self) -> usize {
        self.len() / self.horizon
    }

    /// Appends the episodes of another dataset of the same agent.
    pub fn extend(&mut self, other: &Dataset) {
        self.d_sets.extend(&other.d_sets);
        self.sources.extend(&other.sources);
    }

    pub fn push(&mut self, d_set: &[f32], sources: &[u8]) {
        self.d_sets.push(d_set);
        self.sources.push(sources);
    }
}
