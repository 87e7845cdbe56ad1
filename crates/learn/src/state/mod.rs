//! The state of agents: everything in a run that must survive a period.

pub mod fits;
pub mod stream;

use serde::{Deserialize, Serialize};

use crate::algorithms::Tables;
use crate::policy::JointPolicy;
use crate::state::stream::AgentStream;
use dials_core::base::Ragged;

/// State of some agents after a period. Each table has one row per agent, as wide as its kind has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentsState {
    /// Timesteps per agent so far.
    pub steps: u64,
    pub policies: JointPolicy,
    /// What the learners keep beside the policies. (The optimiser of the AIPs starts from zero at each training.)
    pub learners: Tables,
    /// What the influence predictors have learnt: weights of AIPs, or constants.
    pub aips: Ragged<f32>,
    /// Unfinished episodes.
    pub streams: Vec<AgentStream>,
}

impl AgentsState {
    /// Returns the state of no agents at all.
    pub fn nobody() -> AgentsState {
        AgentsState {
            steps: 0,
            policies: Ragged::default(),
            learners: Tables::default(),
            aips: Ragged::default(),
            streams: Vec::new(),
        }
    }

    pub fn agents(&self) -> usize {
        self.policies.len()
    }

    /// Returns the state of some of the agents, in this order.
    pub fn share(&self, agents: impl IntoIterator<Item = usize> + Clone) -> AgentsState {
        AgentsState {
            steps: self.steps,
            policies: self.policies.pick(agents.clone()),
            learners: self.learners.share(agents.clone()),
            aips: self.aips.pick(agents.clone()),
            streams: agents.into_iter().map(|agent| self.streams[agent].clone()).collect(),
        }
    }

    /// Overwrites the state of the agents from `first` on.
    pub(crate) fn replace(&mut self, first: usize, part: &AgentsState) {
        self.steps = part.steps;
        self.policies.replace(first, &part.policies);
        self.learners.replace(first, &part.learners);
        self.aips.replace(first, &part.aips);
        self.streams[first..][..part.streams.len()].clone_from_slice(&part.streams);
    }

    /// Joins the states of groups of agents, in order, into the state of all.
    pub fn joined(parts: Vec<AgentsState>) -> AgentsState {
        let join = |mut whole: AgentsState, next: AgentsState| {
            debug_assert_eq!(whole.steps, next.steps);
            whole.policies.extend(&next.policies);
            whole.learners.extend(next.learners);
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
    use dials_core::base::Seed;

    #[test]
    fn shares_join_to_the_whole() {
        let stream = |_| AgentStream { rows: vec![] };
        let dice = |agent| vec![Seed::new(agent).dice()];
        let rows = |from: u8| Ragged::from_vec((from..from + 6).map(f32::from).collect(), [2, 3, 1]).unwrap();
        let whole = AgentsState {
            steps: 128,
            policies: rows(0),
            learners: Tables {
                numbers: [("moments".to_owned(), rows(10)), ("squares".to_owned(), rows(20))].into(),
                dice: [("acting".to_owned(), (0..3).map(dice).collect())].into(),
                counts: [("steps".to_owned(), 12)].into(),
            },
            aips: rows(30),
            streams: (0..3).map(stream).collect(),
        };
        let first = whole.share(0..1);
        assert_eq!((first.agents(), first.learners.numbers["squares"].row(0)), (1, &[20.0, 21.0][..]));
        assert_eq!(AgentsState::joined(vec![first, whole.share(1..3)]), whole);
        assert_eq!(AgentsState::joined(vec![]).agents(), 0);
        let mut replaced = whole.clone();
        let mut other = whole.share(1..3);
        other.policies.row_mut(1)[0] = 77.0;
        replaced.replace(1, &other);
        assert_eq!(replaced.share(1..3), other);
        assert_eq!(replaced.share(0..1), whole.share(0..1));
        let turned = whole.share([2, 0, 1]);
        assert_eq!((turned.aips.row(0), turned.policies.row(2)), (&[35.0][..], &[2.0, 3.0, 4.0][..]));
        assert_eq!(turned.share([1, 2, 0]), whole);
    }
}
