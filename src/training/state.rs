//! What agents have become: all of a run that has to survive a period.
//!
//! Dice do not: the streams of a period follow from its number. Simulators do not either: every period begins with
//! fresh episodes, because SUMO cannot save the middle of one exactly.

use std::ops::Range;

use serde::{Deserialize, Serialize};

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
    pub aips: Rows<f32>,
}

impl AgentsState {
    /// The state of no agents at all.
    pub fn nobody() -> AgentsState {
        let none = Rows::new(0, 1);
        let moments = Moments { first: none.clone(), second: none.clone(), steps: 0 };
        AgentsState { steps: 0, policies: none.clone(), moments, aips: none }
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
            aips: self.aips.slice(agents),
        }
    }

    /// Adds the agents that come after these.
    pub fn append(&mut self, next: &AgentsState) {
        debug_assert_eq!((self.steps, self.moments.steps), (next.steps, next.moments.steps));
        self.policies.extend(&next.policies);
        self.moments.first.extend(&next.moments.first);
        self.moments.second.extend(&next.moments.second);
        self.aips.extend(&next.aips);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_join_to_the_whole() {
        let rows = |from: u8| Rows::from_vec((from..from + 6).map(f32::from).collect(), 2);
        let whole = AgentsState {
            steps: 128,
            policies: rows(0),
            moments: Moments { first: rows(10), second: rows(20), steps: 12 },
            aips: rows(30),
        };
        let mut joined = whole.share(0..1);
        assert_eq!((joined.agents(), joined.moments.second.row(0)), (1, &[20.0, 21.0][..]));
        joined.append(&whole.share(1..3));
        assert_eq!(joined, whole);
    }
}
