//! The state of agents: everything in a run that must survive a period.

pub mod fits;
pub mod stream;

use serde::{Deserialize, Serialize};

use crate::algorithms::Tables;
use crate::policy::JointPolicy;
use crate::state::stream::AgentStream;
use dials_core::base::Ragged;

/// State of some agents after a period. Each table has one row per agent, as wide as its kind has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AgentsState {
    pub steps: u64,
    pub policies: JointPolicy,
    /// What the learners keep beside the policies. (The optimiser of the AIPs starts from zero at each training.)
    pub learners: Tables,
    /// What the influence predictors have learnt: weights of AIPs, or constants.
    pub aips: Ragged<f32>,
    pub streams: Vec<AgentStream>,
    /// What a predictor outside of this program has learnt for all agents together: only that can read it. Empty before its
    /// first training. Workers do not have it.
    pub outside_aips: Vec<u8>,
}

impl AgentsState {
    pub fn nobody() -> AgentsState {
        AgentsState::default()
    }

    pub fn agents(&self) -> usize {
        self.policies.len()
    }

    pub fn share(&self, agents: impl IntoIterator<Item = usize> + Clone) -> AgentsState {
        AgentsState {
            steps: self.steps,
            policies: self.policies.pick(agents.clone()),
            learners: self.learners.share(agents.clone()),
            aips: self.aips.pick(agents.clone()),
            streams: agents.into_iter().map(|agent| self.streams[agent].clone()).collect(),
            outside_aips: Vec::new(),
        }
    }

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
        parts.into_iter().reduce(join).unwrap_or_default()
    }
}
