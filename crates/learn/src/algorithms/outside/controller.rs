//! The learner outside as a controller on the GS. It decides for all agents at once, and learns nothing.

use rand::Rng;

use super::{Waiting, check_actions, with};
use dials_core::base::{AgentId, Dice, RandomPurpose, Rows, Seed};
use dials_core::domain::{Action, Controller, JointPercept, Kinds, Result};

pub(crate) struct OutsideController {
    agents: Vec<u32>,
    /// Always 0.
    copies: Vec<u32>,
    dice: Vec<Dice>,
    obs: Rows<f32>,
    masks: Rows<bool>,
}

impl OutsideController {
    /// Makes a controller. Rows are as wide as the widest kind; what others do not need is 0 and not allowed.
    pub(crate) fn new(kinds: &Kinds) -> Self {
        let widest = |of: &dyn Fn(&Kinds) -> Vec<usize>| of(kinds).into_iter().max().unwrap_or(0);
        let width = widest(&|kinds| kinds.specs().map(|spec| spec.obs_dim).collect());
        let n_actions = widest(&|kinds| kinds.specs().map(|spec| spec.n_actions).collect());
        let agents = kinds.agents();
        let mut masks = Rows::new(agents, n_actions);
        for (agent, spec) in kinds.specs().enumerate() {
            masks.row_mut(agent)[..spec.n_actions].fill(true);
        }
        OutsideController {
            agents: (0..agents as u32).collect(),
            copies: vec![0; agents],
            dice: Vec::new(),
            obs: Rows::new(agents, width),
            masks,
        }
    }
}

impl Controller for OutsideController {
    fn begin(&mut self, episode: Seed) {
        let agents = AgentId::all(self.agents.len());
        self.dice = episode.fork(RandomPurpose::Acting).for_agents(&agents).collect();
    }

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        for (agent, (obs, masks)) in percept.obs.iter().zip(percept.masks.iter()).enumerate() {
            self.obs.row_mut(agent)[..obs.len()].copy_from_slice(obs);
            // Without masks all are allowed, as at the beginning.
            self.masks.row_mut(agent)[..masks.len()].copy_from_slice(masks);
        }
        let uniform: Vec<f32> = self.dice.iter_mut().map(Rng::random).collect();
        let OutsideController { agents, copies, obs, masks, .. } = &*self;
        let waiting = Waiting { agents, copies, obs, masks, uniform: &uniform, training_steps: None };
        let chosen = with(|learner| learner.act(&waiting))?;
        check_actions(&chosen, masks)?;
        actions.copy_from_slice(&chosen);
        Ok(())
    }
}
