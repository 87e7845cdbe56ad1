//! What simulators show: percepts and transitions of rows of one kind (LS), and joint ones of all agents (GS).

use super::{Kinds, RegionSpec};
use crate::base::{Ragged, Rows};

/// A percept: the data that regions of one kind show at a decision, one row per (agent, copy).
#[derive(Clone, Debug, PartialEq)]
pub struct Percept {
    /// Observations, `[rows, obs_dim]`.
    pub obs: Rows<f32>,
    /// D-sets, `[rows, d_set_dim]`.
    pub d_set: Rows<f32>,
    /// Actions that are allowed now, `[rows, n_actions]`, at least one per row. `None` if the kind has no masks.
    /// Policies never choose another action. A simulator may treat another one as it likes, but it must go on.
    pub masks: Option<Rows<bool>>,
}

impl Percept {
    /// Makes a percept of zeros in which every action is allowed.
    pub fn new(rows: usize, spec: &RegionSpec) -> Self {
        Percept {
            obs: Rows::new(rows, spec.obs_dim),
            d_set: Rows::new(rows, spec.d_set_dim),
            masks: spec.masks.then(|| Rows::from_vec(vec![true; rows * spec.n_actions], spec.n_actions)),
        }
    }
}

/// The result of one step of a local simulator.
#[derive(Clone, Debug, PartialEq)]
pub struct Transition {
    pub percept: Percept,
    /// Rewards, `[rows]`.
    pub rewards: Vec<f32>,
}

impl Transition {
    pub fn new(rows: usize, spec: &RegionSpec) -> Self {
        Transition { percept: Percept::new(rows, spec), rewards: vec![0.0; rows] }
    }
}

/// The percept of the regions of all agents at a decision, one row per agent, as wide as its kind needs.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPercept {
    pub obs: Ragged<f32>,
    pub d_set: Ragged<f32>,
    /// Actions that are allowed now. The row of an agent whose kind has no masks is empty.
    pub masks: Ragged<bool>,
}

impl JointPercept {
    /// Makes a percept of zeros in which every action is allowed.
    pub fn new(kinds: &Kinds) -> Self {
        let mut masks = Ragged::new(kinds.specs().map(|spec| if spec.masks { spec.n_actions } else { 0 }));
        masks.fill(true);
        JointPercept {
            obs: Ragged::new(kinds.specs().map(|spec| spec.obs_dim)),
            d_set: Ragged::new(kinds.specs().map(|spec| spec.d_set_dim)),
            masks,
        }
    }

    /// Copies another percept of the same kinds.
    pub fn copy_from(&mut self, other: &JointPercept) {
        self.obs.copy_from(&other.obs);
        self.d_set.copy_from(&other.d_set);
        self.masks.copy_from(&other.masks);
    }

    /// Copies what the agents of one kind see; `percept` has one row for each of them.
    pub fn of_kind(&self, kinds: &Kinds, kind: usize, percept: &mut Percept) {
        let agents = || kinds[kind].agents.iter().map(|agent| agent.0);
        self.obs.pick_into(agents(), &mut percept.obs);
        self.d_set.pick_into(agents(), &mut percept.d_set);
        if let Some(masks) = &mut percept.masks {
            self.masks.pick_into(agents(), masks);
        }
    }
}

/// The result of one step of the global simulator.
#[derive(Clone, Debug, PartialEq)]
pub struct JointTransition {
    pub percept: JointPercept,
    /// Rewards, `[agents]`.
    pub rewards: Vec<f32>,
}

impl JointTransition {
    pub fn new(kinds: &Kinds) -> Self {
        JointTransition { percept: JointPercept::new(kinds), rewards: vec![0.0; kinds.agents()] }
    }
}
