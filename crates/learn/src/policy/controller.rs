//! Policies that act: a stack on rows of its kind, and a joint policy on the GS, in evaluation and
//! in the collection of datasets.

use super::{JointPolicy, PolicyStack};
use crate::algorithms;
use crate::algorithms::outside::controller::OutsideController;
use crate::config::Config;
use dials_core::base::{AgentId, Dice, RandomPurpose, Rows, Seed};
use dials_core::domain::sampling::{self, Selection};
use dials_core::domain::{Action, Controller, JointPercept, Kind, Kinds, Percept, RegionSpec, Result};
use stacknets::States;

/// The policies of some agents of one kind, one row each.
pub struct StackController {
    stack: PolicyStack,
    selection: Selection,
    dice: Vec<Dice>,
    states: States,
}

impl StackController {
    /// Makes a controller. `policies`: one row per agent.
    pub fn new(spec: &RegionSpec, config: &Config, policies: &Rows<f32>, selection: Selection) -> Self {
        let stack = PolicyStack::blank(policies.len(), spec, &config.policy);
        let mut stack = stack.read_as(algorithms::of(config).reading());
        stack.load(policies);
        let states = stack.states(stack.agents());
        StackController { stack, selection, dice: Vec::new(), states }
    }

    /// Begins an episode. `agents`: the agents whose dice the rows use.
    pub fn begin(&mut self, episode: Seed, agents: &[AgentId]) {
        self.states = self.stack.states(self.stack.agents());
        self.dice = episode.fork(RandomPurpose::Acting).for_agents(agents).collect();
    }

    /// Chooses one action per row of the percept.
    pub fn act(&mut self, percept: &Percept) -> Vec<Action> {
        let judgement = self.stack.decide(0..self.stack.agents(), self.stack.net.threads(), percept, &mut self.states);
        let mut log_probs = vec![0.0; self.stack.n_actions()];
        let choose = |((logits, _), dice): ((&[f32], f32), &mut Dice)| {
            sampling::log_softmax(logits, &mut log_probs);
            self.selection.choose(&log_probs, dice)
        };
        judgement.rows().zip(&mut self.dice).map(choose).collect()
    }
}

/// All agents' policies as a [`Controller`].
pub struct JointPolicyController {
    kinds: Kinds,
    /// Stacks, one per kind, each with what its agents see.
    stacks: Vec<(StackController, Percept)>,
    /// Decides instead of them.
    outside: Option<OutsideController>,
}

impl JointPolicyController {
    /// Makes a controller. `policies`: one row per agent of `kinds`.
    pub fn new(kinds: &Kinds, config: &Config, policies: &JointPolicy, selection: Selection) -> Self {
        let of_kind = |kind: &Kind| {
            let policies = policies.pick(kind.agents.iter().map(|agent| agent.0)).into_rows();
            let stack = StackController::new(&kind.spec, config, &policies, selection);
            (stack, Percept::new(kind.agents.len(), &kind.spec))
        };
        let outside = config.learns_outside().then(|| OutsideController::new(kinds));
        JointPolicyController { stacks: kinds.iter().map(of_kind).collect(), kinds: kinds.clone(), outside }
    }
}

impl Controller for JointPolicyController {
    fn begin(&mut self, episode: Seed) {
        if let Some(outside) = &mut self.outside {
            return outside.begin(episode);
        }
        let stacks = self.stacks.iter_mut().zip(self.kinds.iter());
        stacks.for_each(|((stack, _), kind)| stack.begin(episode, &kind.agents));
    }

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        if let Some(outside) = &mut self.outside {
            return outside.act(percept, actions);
        }
        for (index, (stack, seen)) in self.stacks.iter_mut().enumerate() {
            percept.of_kind(&self.kinds, index, seen);
            let chosen = stack.act(seen);
            self.kinds[index].agents.iter().zip(chosen).for_each(|(agent, action)| actions[agent.0] = action);
        }
        Ok(())
    }
}
