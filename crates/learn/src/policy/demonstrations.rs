//! Demonstrations: what one agent saw and did while a hand-coded controller decided for it.

use serde::{Deserialize, Serialize};

use dials_core::base::{CompactRows, Rows};
use dials_core::domain::{Action, Kinds, RegionSpec};

/// Observations and actions of one agent in the order in which the GS made them: whole episodes, one after another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Demonstrations {
    /// `[samples, obs_dim]`
    pub obs: CompactRows,
    /// Actions that were allowed, `[samples, n_actions]`; `None` if the kind has no masks.
    masks: Option<Rows<bool>>,
    /// Actions of the controller. `None`: no action would have changed anything, so there is nothing to imitate.
    pub actions: Vec<Option<Action>>,
    /// Number of samples per episode.
    pub(crate) horizon: usize,
}

impl Demonstrations {
    pub(crate) fn new(spec: &RegionSpec) -> Self {
        Demonstrations {
            obs: CompactRows::new(spec.obs_dim),
            masks: spec.masks.then(|| Rows::new(0, spec.n_actions)),
            actions: Vec::new(),
            horizon: spec.horizon,
        }
    }

    pub fn of_all(kinds: &Kinds) -> Vec<Demonstrations> {
        kinds.specs().map(Demonstrations::new).collect()
    }

    pub fn episodes(&self) -> usize {
        self.actions.len() / self.horizon
    }

    /// Returns whether these are `samples` samples of a region, with actions that it has.
    pub(crate) fn fits(&self, spec: &RegionSpec, samples: usize) -> bool {
        let Demonstrations { obs, masks, actions, horizon } = self;
        let masks = match masks {
            Some(masks) => spec.masks && (masks.len(), masks.width()) == (samples, spec.n_actions),
            None => !spec.masks,
        };
        (obs.len(), obs.width(), actions.len(), *horizon) == (samples, spec.obs_dim, samples, spec.horizon)
            && masks
            && actions.iter().flatten().all(|&action| usize::from(action) < spec.n_actions)
    }

    /// Returns the actions that were allowed; empty if all always are.
    pub(crate) fn mask(&self, sample: usize) -> &[bool] {
        self.masks.as_ref().map_or(&[], |masks| masks.row(sample))
    }

    /// Appends a decision. `mask`: the actions that were allowed, or empty.
    pub(crate) fn push(&mut self, obs: &[f32], mask: &[bool], action: Option<Action>) {
        self.obs.push(obs);
        if let Some(masks) = &mut self.masks {
            masks.push(mask);
        }
        self.actions.push(action);
    }

    pub(crate) fn extend(&mut self, other: &Demonstrations) {
        self.obs.extend(&other.obs);
        if let (Some(mine), Some(theirs)) = (&mut self.masks, &other.masks) {
            mine.extend(theirs);
        }
        self.actions.extend_from_slice(&other.actions);
    }
}
