//! Ids and units that would otherwise be bare integers.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Agent of the whole system, numbered from 0 in the domain's order (traffic: row-major from the south-west corner).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct AgentId(pub usize);

impl AgentId {
    /// Returns the agents `0..count`.
    pub fn all(count: usize) -> Vec<AgentId> {
        (0..count).map(AgentId).collect()
    }
}

impl fmt::Display for AgentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
