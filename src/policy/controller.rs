//! A joint policy that drives the GS: in evaluation and in the collection of datasets.

use super::{JointPolicy, PolicyStack, sampling};
use crate::base::{AgentId, Dice, RandomPurpose, Seed};
use crate::domain::{Action, Controller, Percept, Result};
use crate::nn::States;

/// How an action follows from its probabilities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Drawn from the policy, as in training.
    Sampled,
    /// The most probable one.
    Greedy,
}

/// All agents' policies as a [`Controller`].
pub struct JointPolicyController {
    stack: PolicyStack,
    selection: Selection,
    dice: Vec<Dice>,
    states: States,
}

impl JointPolicyController {
    /// `stack`: policies of all agents of the GS, of the right shape; their parameters become `policies`.
    pub fn new(mut stack: PolicyStack, policies: &JointPolicy, selection: Selection) -> Self {
        stack.load(policies);
        let states = stack.states(stack.agents());
        JointPolicyController { stack, selection, dice: Vec::new(), states }
    }
}

impl Controller for JointPolicyController {
    fn begin(&mut self, episode: Seed) {
        self.states = self.stack.states(self.stack.agents());
        let acting = episode.fork(RandomPurpose::Acting);
        self.dice = AgentId::all(self.stack.agents()).into_iter().map(|agent| acting.for_agent(agent).dice()).collect();
    }

    fn act(&mut self, percept: &Percept, actions: &mut [Action]) -> Result<()> {
        let judgement = self.stack.judge(&percept.obs, &mut self.states);
        let mut log_probs = vec![0.0; self.stack.n_actions()];
        for ((action, (logits, _)), dice) in actions.iter_mut().zip(judgement.rows()).zip(&mut self.dice) {
            sampling::log_softmax(logits, &mut log_probs);
            *action = match self.selection {
                Selection::Sampled => sampling::draw(&log_probs, dice),
                Selection::Greedy => sampling::most_probable(&log_probs),
            };
        }
        Ok(())
    }
}
