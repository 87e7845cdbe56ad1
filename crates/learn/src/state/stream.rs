//! The stream of training: the episodes that continue from one period to the next.
//!
//! Evaluations, datasets and checkpoints cut training into periods, and at each cut the simulators are lost. SUMO holds
//! one simulation per process, and cannot save the middle of one exactly. But a local region follows from its actions
//! and influence sources since its episode began, and the GS from its seed and actions. A [`Trail`] keeps these.
//! Replayed in a new simulator, they lead to exactly the same state. So training continues as if there had been no cut.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::config::Config;
use dials_core::base::{AgentId, Dice, RandomPurpose, Rows, Seed, scramble};
use dials_core::domain::{Action, Percept};

/// State of one agent's episodes between two periods.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentStream {
    /// One stream per copy of the agent's region.
    pub rows: Vec<RowStream>,
}

/// State of one copy of an agent's region between two periods.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RowStream {
    pub trail: Trail,
    /// Dice for the influence sources; unused on the GS.
    pub influence: Dice,
    /// Sum of the rewards since the episode began.
    pub rewards: f64,
}

/// All actions and influences of a local region since its episode began.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Trail {
    /// Number of the episode in this row, from 0.
    pub episode: u64,
    pub actions: Vec<Action>,
    /// Influence sources, step after step; empty on the GS.
    pub sources: Vec<u8>,
    /// Fingerprint of what the row shows now. It checks that a replay of the trail leads to the same place. Written
    /// when a period ends.
    pub shown: u64,
}

impl RowStream {
    /// Makes a row whose first episode begins.
    pub fn begin(influence: Dice) -> RowStream {
        RowStream { trail: Trail::default(), influence, rewards: 0.0 }
    }
}

impl AgentStream {
    pub fn begin(config: &Config, agent: AgentId) -> AgentStream {
        let influence = Seed::new(config.seed).fork(RandomPurpose::Influence).for_agent(agent);
        let row = |copy: usize| RowStream::begin(influence.for_copy(copy).dice());
        AgentStream { rows: (0..config.copies()).map(row).collect() }
    }
}

/// Some copies of some agents of a kind: the rows of an environment, ordered by agent, then by copy.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    pub agents: Range<usize>,
    pub copies: Range<usize>,
}

impl Part {
    pub fn rows(&self) -> usize {
        self.agents.len() * self.copies.len()
    }

    /// Returns agent and copy of a row.
    pub(crate) fn place(&self, row: usize) -> (usize, usize) {
        let copies = self.copies.len();
        (self.agents.start + row / copies, self.copies.start + row % copies)
    }

    /// Returns the row of a copy of an agent; `None` if it is in another part.
    pub(crate) fn row(&self, agent: usize, copy: usize) -> Option<usize> {
        let is_here = self.agents.contains(&agent) && self.copies.contains(&copy);
        is_here.then(|| (agent - self.agents.start) * self.copies.len() + copy - self.copies.start)
    }

    /// Returns the streams of its rows. `streams`: those of all agents of the kind.
    pub(crate) fn of<'a>(&self, streams: &'a [AgentStream]) -> impl Iterator<Item = &'a RowStream> {
        let copies = self.copies.clone();
        streams[self.agents.clone()].iter().flat_map(move |stream| &stream.rows[copies.clone()])
    }

    pub(crate) fn of_mut<'a>(&self, streams: &'a mut [AgentStream]) -> impl Iterator<Item = &'a mut RowStream> {
        let copies = self.copies.clone();
        streams[self.agents.clone()].iter_mut().flat_map(move |stream| &mut stream.rows[copies.clone()])
    }
}

impl Trail {
    pub fn steps(&self) -> usize {
        self.actions.len()
    }

    pub(crate) fn push(&mut self, action: Action, sources: &[u8]) {
        self.actions.push(action);
        self.sources.extend_from_slice(sources);
    }

    pub(crate) fn end_episode(&mut self) {
        self.episode += 1;
        self.actions.clear();
        self.sources.clear();
    }
}

/// Returns a number that hardly any two percepts of a row share. It is stable across builds, because checkpoints hold
/// it.
pub(crate) fn fingerprint(percept: &Percept, row: usize) -> u64 {
    let tables: [&Rows<f32>; 2] = [&percept.obs, &percept.d_set];
    let values = tables.into_iter().flat_map(|table| table.row(row)).map(|value| u64::from(value.to_bits()));
    let allowed = percept.masks.iter().flat_map(|masks| masks.row(row)).map(|&allowed| u64::from(allowed));
    values.chain(allowed).fold(0, |hash, bits| scramble(hash.wrapping_add(1) ^ bits))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percepts_that_differ_in_one_number_have_other_fingerprints() {
        let percept = |values: [f32; 4]| Percept {
            obs: Rows::from_vec(values[..2].to_vec(), 2),
            d_set: Rows::from_vec(values[2..].to_vec(), 2),
            masks: None,
        };
        let all = [[0.0; 4], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, -0.0]];
        let prints: Vec<u64> = all.iter().map(|&values| fingerprint(&percept(values), 0)).collect();
        assert!((0..5).all(|i| (0..i).all(|j| prints[i] != prints[j])), "{prints:?}");
        assert_eq!(fingerprint(&percept([0.0; 4]), 0), prints[0]);
        let masked = |mask: [bool; 2]| Percept { masks: Some(Rows::from_vec(mask.to_vec(), 2)), ..percept([0.0; 4]) };
        assert_ne!(fingerprint(&masked([true, false]), 0), fingerprint(&masked([true, true]), 0));
    }
}
