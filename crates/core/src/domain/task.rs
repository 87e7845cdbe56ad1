//! What an agent sees, does and is rewarded for, in words. For people only: nothing is computed from it.

use serde::Serialize;

use super::RegionSpec;

/// The task of one agent. Its lists have no padding: an agent that is smaller than its kind has fewer names here.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Task {
    /// Names of the columns of an observation.
    pub observation: Vec<String>,
    /// Names of the actions.
    pub actions: Vec<String>,
    /// What the agent is rewarded for a step, a sentence.
    pub reward: String,
    /// Names of the influence sources: what the AIP predicts.
    pub sources: Vec<String>,
    /// Names of the columns of the d-set: what the AIP sees.
    pub d_set: Vec<String>,
}

impl Task {
    /// Returns the task of an agent of which only the shape is known.
    pub(crate) fn of_shape(spec: &RegionSpec) -> Task {
        let numbered = |name: &str, count: usize| (0..count).map(|number| format!("{name}[{number}]")).collect();
        Task {
            observation: numbered("observation", spec.obs_dim),
            actions: numbered("action", spec.n_actions),
            reward: "not described by this domain".to_owned(),
            sources: numbered("source", spec.sources.count()),
            d_set: numbered("d-set", spec.d_set_dim),
        }
    }
}
