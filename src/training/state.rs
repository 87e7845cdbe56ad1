//! What agents have become: all of a run that has to survive a period.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::stream::AgentStream;
use crate::base::Rows;
use crate::nn::Moments;
use crate::policy::JointPolicy;

/// The state of some agents after a period, one row per agent in each table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentsState {
    /// Timesteps per agent so far.
    pub steps: u64,
    pub policies: JointPolicy,
    /// Of the policies' optimiser. (That of the AIPs starts afresh at each training.)
    pub moments: Moments,
    /// What the influence predictors have learnt: weights of AIPs, or constants.
    pub aips: Rows<f32>,
    /// Where their training stands: episodes under way and dice.
    pub streams: Vec<AgentStream>,
}

impl AgentsState {
    /// The state of no agents at all.
    pub fn nobody() -> AgentsState {
        let none = Rows::new(0, 1);
        let moments = Moments { first: none.clone(), second: none.clone(), steps: 0 };
        AgentsState { steps: 0, policies: none.clone(), moments, aips: none, streams: Vec::new() }
    }

    pub fn agents(&self) -> usize {
        self.policies.len()
    }

    /// The share of some of the agents.
    pub fn share(&self, agents: Range<usize>) -> AgentsState {
        AgentsState {
            steps: self.steps,
            policies: self.policies.slice(agents.clone()),
            moments: Moments {
                first: self.moments.first.slice(agents.clone()),
                second: self.moments.second.slice(agents.clone()),
                steps: self.moments.steps,
            },
            aips: self.aips.slice(agents.clone()),
            streams: self.streams[agents].to_vec(),
        }
    }

    /// Takes over the state of the agents from `first` on, one after another.
    pub fn replace(&mut self, first: usize, part: &AgentsState) {
        self.steps = part.steps;
        self.moments.steps = part.moments.steps;
        self.policies.replace(first, &part.policies);
        self.moments.first.replace(first, &part.moments.first);
        self.moments.second.replace(first, &part.moments.second);
        self.aips.replace(first, &part.aips);
        self.streams[first..][..part.streams.len()].clone_from_slice(&part.streams);
    }

    /// The state of all agents, from those of some, in order.
    pub fn joined(parts: Vec<AgentsState>) -> AgentsState {
        let join = |mut whole: AgentsState, next: AgentsState| {
            debug_assert_eq!((whole.steps, whole.moments.steps), (next.steps, next.moments.steps));
            whole.policies.extend(&next.policies);
            whole.moments.first.extend(&next.moments.first);
            whole.moments.second.extend(&next.moments.second);
            whole.aips.extend(&next.aips);
            whole.streams.extend(next.streams);
            whole
        };
        parts.into_iter().reduce(join).unwrap_or_else(AgentsState::nobody)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Seed;

    #[test]
    fn shares_join_to_the_whole() {
        let stream = |agent| AgentStream { minibatches: Seed::new(agent).dice(), rows: vec![] };
        let rows = |from: u8| Rows::from_vec((from..from + 6).map(f32::from).collect(), 2);
        let whole = AgentsState {
            steps: 128,
            policies: rows(0),
            moments: Moments { first: rows(10), second: rows(20), steps: 12 },
            aips: rows(30),
            streams: (0..3).map(stream).collect(),
        };
        let first = whole.share(0..1);
        assert_eq!((first.agents(), first.moments.second.row(0)), (1, &[20.0, 21.0][..]));
        assert_eq!(AgentsState::joined(vec![first, whole.share(1..3)]), whole);
        assert_eq!(AgentsState::joined(vec![]).agents(), 0);
        let mut replaced = whole.clone();
        replaced.replace(1, &whole.share(0..2));
        assert_eq!(replaced.share(1..3), whole.share(0..2));
        assert_eq!(replaced.share(0..1), whole.share(0..1));
    }
}
