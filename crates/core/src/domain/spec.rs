//! The shape of one local region: everything that networks and learning need to know of a domain. And its task in words,
//! for people only: nothing is computed from it.

use serde::Serialize;
use stacknets::{Rows, Sets};

/// An action of one agent: an index below [`RegionSpec::n_actions`].
pub type Action = u8;

/// A trained policy from which others may start.
#[derive(Clone, Debug, PartialEq)]
pub struct StartingPolicy {
    /// Widths of its hidden layers.
    pub hidden: Vec<usize>,
    /// Its parameters, as a network with these layers has them.
    pub parameters: Rows<f32>,
}

/// The shape of one local region. All regions of a kind have the same shape.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RegionSpec {
    /// Width of an observation `o_i`.
    pub obs_dim: usize,
    /// Width of the d-separating set (d-set): what the AIP sees at each step. It is a part of the ALSH.
    pub d_set_dim: usize,
    pub n_actions: usize,
    /// Whether observations are sets, one choice per action, and how they lie. Policies are then networks over sets.
    pub sets: Option<Sets>,
    /// Whether percepts say which actions are allowed. Otherwise all are, always.
    pub masks: bool,
    pub sources: SourceSpec,
    /// Number of steps of an episode of the GS, the same for all kinds of a domain.
    pub horizon: usize,
    /// Number of steps of an episode of the LS. Each exchange retraces the episodes under way, so long ones cost much.
    pub local_horizon: usize,
}

/// The influence sources `u_i` of a region: independent choices of one class each. Class 0 means that nothing happens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceSpec {
    /// Number of classes of each source. A source of two classes is a bit (did a car enter on this edge?), predicted by
    /// one logit and a sigmoid. A source of K > 2 classes (where is this neighbour?) is predicted by K logits and a
    /// softmax.
    pub classes: Vec<u8>,
    /// Number of parts of an episode between which the sources may change how often they happen; 0 for none. The first
    /// columns of the d-set are the one-hot of the part.
    pub parts: usize,
}

impl SourceSpec {
    /// Makes sources that happen or do not.
    pub fn bits(sources: usize) -> SourceSpec {
        SourceSpec { classes: vec![2; sources], parts: 0 }
    }

    pub fn count(&self) -> usize {
        self.classes.len()
    }

    /// Returns the number of logits of an AIP for these sources.
    pub fn logits(&self) -> usize {
        self.classes.iter().map(|&classes| logits_of(classes)).sum()
    }

    /// Returns the number of classes of all sources together.
    pub fn values(&self) -> usize {
        self.classes.iter().map(|&classes| usize::from(classes)).sum()
    }
}

/// Returns the number of logits for a source of `classes` classes.
pub fn logits_of(classes: u8) -> usize {
    if classes == 2 { 1 } else { usize::from(classes) }
}

/// The task of one agent. Its lists have no padding: an agent that is smaller than its kind has fewer names here.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Task {
    pub observation: Vec<String>,
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
