//! Rollouts: T decisions of every row of a lane, with their advantages.

use super::gae::advantages;
use super::memory::{Memory, Sample};
use super::value_unit::ValueUnits;
use crate::algorithms::Actor;
use crate::config::{PpoConfig, TimeLimit};
use crate::environments::Experience;
use crate::policy::PolicyStack;
use crate::state::stream::Part;
use dials_core::base::{Dice, Phase, Rows, Stopwatch};
use dials_core::domain::sampling;
use dials_core::domain::{Action, Percept};
use stacknets::{States, Threads};

/// The networks that act, the units of their values, and the threads that one lane may use.
#[derive(Clone, Copy)]
pub(super) struct Critics<'a> {
    pub(super) policies: &'a PolicyStack,
    pub(super) units: &'a ValueUnits,
    pub(super) threads: &'a Threads,
}

/// A rollout of a lane under way, and the acting state that goes on from one rollout to the next.
pub(super) struct Rollout {
    config: PpoConfig,
    part: Part,
    /// Whether the value of the last row stands for what would come for all rows, see `gs.bootstrap`.
    shared_bootstrap: bool,
    /// Hidden states of the policies, one per row.
    pub(crate) states: States,
    /// Whether an episode begins with the row's next decision.
    starts: Vec<bool>,
    /// What its rows go through: T samples per copy, copy after copy.
    memory: Memory,
    /// `[steps so far, rows]`; the same for the values and the ends.
    rewards: Vec<f32>,
    values: Vec<f32>,
    ends: Vec<bool>,
}

/// A lane's rollout, with all that it takes to go on.
pub(super) struct RolloutActor<'a> {
    pub(super) critics: Critics<'a>,
    pub(super) rollout: &'a mut Rollout,
    /// One per row.
    pub(super) dice: &'a mut [Dice],
}

impl Actor for RolloutActor<'_> {
    fn act(&mut self, percept: &Percept) -> Vec<Action> {
        self.rollout.act(self.critics, self.dice, percept)
    }

    fn take_in(&mut self, experience: &Experience, next: &Percept, watch: &mut Stopwatch) {
        if self.rollout.take_in(self.critics, experience, watch) {
            self.rollout.finish(self.critics, next, watch);
        }
    }
}

impl Rollout {
    /// Begins the first rollout. `memory`: empty, with T samples per agent and copy of the part; `states`: one per row.
    pub(super) fn new(
        config: &PpoConfig,
        shared_bootstrap: bool,
        part: &Part,
        memory: Memory,
        states: States,
    ) -> Rollout {
        Rollout {
            config: config.clone(),
            part: part.clone(),
            shared_bootstrap,
            starts: vec![true; states.rows()],
            states,
            memory,
            rewards: Vec::new(),
            values: Vec::new(),
            ends: Vec::new(),
        }
    }

    pub(super) fn part(&self) -> &Part {
        &self.part
    }

    /// Returns the samples of the last rollout that was finished.
    pub(super) fn memory(&self) -> &Memory {
        &self.memory
    }

    fn rows(&self) -> usize {
        self.starts.len()
    }

    /// Returns the agent of a row, counted in its part, and the slot for its step `t`.
    fn slot(&self, t: usize, row: usize) -> (usize, usize) {
        let copies = self.part.copies.len();
        (row / copies, row % copies * self.config.rollout_steps + t)
    }

    /// Chooses one action per row, and records the decisions. `dice`: one per row.
    fn act(&mut self, critics: Critics<'_>, dice: &mut [Dice], percept: &Percept) -> Vec<Action> {
        let Critics { policies, units, threads } = critics;
        let t = self.rewards.len() / self.rows();
        let before = self.states.clone();
        let judgement = policies.decide(self.part.agents.clone(), threads, percept, &mut self.states);
        let mut log_probs = vec![0.0; policies.n_actions()];
        let mut actions = Vec::with_capacity(self.rows());
        for (row, ((logits, output), dice)) in judgement.rows().zip(dice).enumerate() {
            sampling::log_softmax(logits, &mut log_probs);
            let (agent, slot) = self.slot(t, row);
            let value = units.of(self.part.agents.start + agent).value_of(output);
            let action = sampling::draw(&log_probs, dice);
            let log_prob = log_probs[usize::from(action)];
            let sample = Sample { action, log_prob, value, output, start: self.starts[row], ..Sample::default() };
            let mask = percept.masks.as_ref().map_or(&[][..], |masks| masks.row(row));
            self.memory.remember(agent, slot, (percept.obs.row(row), mask), before.row(row), sample);
            actions.push(action);
            self.values.push(value);
        }
        actions
    }

    /// Records what the actions brought. Returns whether the rollout has all its steps.
    fn take_in(&mut self, critics: Critics<'_>, experience: &Experience, watch: &mut Stopwatch) -> bool {
        let now = self.rewards.len();
        self.rewards.extend_from_slice(&experience.rewards);
        self.ends.extend_from_slice(&experience.ends);
        if self.config.time_limit == TimeLimit::Bootstrap && experience.ends.contains(&true) {
            watch.time(Phase::Acting, || self.credit_what_would_come(critics, experience, now));
        }
        self.starts.copy_from_slice(&experience.ends);
        (0..self.rows()).filter(|&row| experience.ends[row]).for_each(|row| self.states.clear(row));
        self.rewards.len() == self.config.rollout_steps * self.rows()
    }

    /// Gives its samples their advantages and returns, and begins the next rollout. `next`: what the rows show after the
    /// last step.
    fn finish(&mut self, critics: Critics<'_>, next: &Percept, watch: &mut Stopwatch) {
        let last_values = watch.time(Phase::Acting, || self.bootstrap(critics, &next.obs));
        watch.time(Phase::Bookkeeping, || {
            let (gamma, lambda) = (self.config.gamma as f32, self.config.gae_lambda as f32);
            let advantages = advantages(&self.rewards, &self.values, &self.ends, &last_values, gamma, lambda);
            for (i, &advantage) in advantages.iter().enumerate() {
                let (agent, slot) = self.slot(i / self.rows(), i % self.rows());
                let sample = self.memory.sample_mut(agent, slot);
                sample.advantage = advantage;
                sample.ret = advantage + sample.value;
            }
        });
        self.rewards.clear();
        self.values.clear();
        self.ends.clear();
    }

    /// Returns the values of these observations, one per row, which stand for what would come.
    fn bootstrap(&self, Critics { policies, units, threads }: Critics<'_>, obs: &Rows<f32>) -> Vec<f32> {
        let judgement = policies.judge(self.part.agents.clone(), threads, obs, &mut self.states.clone());
        let value = |(row, (_, output))| units.of(self.part.place(row).0).value_of(output);
        let mut values: Vec<f32> = judgement.rows().enumerate().map(value).collect();
        if let (true, Some(&last)) = (self.shared_bootstrap, values.last()) {
            values.fill(last);
        }
        values
    }

    /// Adds the discounted value of the last observation to the rewards of the rows whose episode the time limit cut.
    /// The value is computed with the policy's hidden state at that step. `now`: where this step's rewards begin.
    ///
    /// DEVIATION 8: in the authors' code nothing comes after the horizon (`time_limit = "terminal"`). But an agent sees
    /// no clock, so its critic cannot know.
    fn credit_what_would_come(&mut self, critics: Critics<'_>, experience: &Experience, now: usize) {
        let values = self.bootstrap(critics, &experience.last_obs);
        let gamma = self.config.gamma as f32;
        for ((reward, &end), value) in self.rewards[now..].iter_mut().zip(&experience.ends).zip(values) {
            if end {
                *reward += gamma * value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{PolicyConfig, ValueUnit};
    use crate::fixtures::{dice, region};
    use dials_core::base::{AgentId, Seed};
    use dials_core::domain::{RegionSpec, SourceSpec};

    const T: usize = 4;
    /// Two agents with two copies each.
    const PART: Part = Part { agents: 0..2, copies: 0..2 };

    fn units() -> ValueUnits {
        ValueUnits::new(ValueUnit::Reward, 2)
    }

    /// Returns the step of its episode at which a row is at a step of training. There are two agents with two copies each.
    /// The episodes of row 1 end after every third step, the others never.
    fn age(row: usize, step: usize) -> usize {
        if row == 1 { step % 3 } else { step }
    }

    fn ends(row: usize, step: usize) -> bool {
        row == 1 && step % 3 == 2
    }

    fn shown(row: usize, age: usize) -> f32 {
        (10 * row + age) as f32
    }

    fn reward(row: usize, step: usize) -> f32 {
        row as f32 + age(row, step) as f32 / 10.0
    }

    fn spec() -> RegionSpec {
        region(1, 1, SourceSpec::bits(1), 3)
    }

    /// Returns what all rows show at a step.
    fn percept(step: usize) -> Percept {
        let obs = (0..4).map(|row| shown(row, age(row, step))).collect();
        Percept { obs: Rows::from_vec(obs, 1), ..Percept::new(4, &spec()) }
    }

    /// Makes networks whose value is the observation plus, with memory, a part of the state.
    fn policies(recurrent: Option<usize>) -> PolicyStack {
        let config = PolicyConfig { recurrent, hidden: vec![4], ..PolicyConfig::default() };
        PolicyStack::new(&AgentId::all(2), &spec(), &config, &[0.0; 2], Seed::new(6))
    }

    /// Records two rollouts of four steps in a memory of 16 per agent.
    fn recorded(recurrent: Option<usize>, time_limit: TimeLimit) -> (Memory, PolicyStack) {
        let policies = policies(recurrent);
        let length = if recurrent.is_some() { 2 } else { 1 };
        let memory = |samples| Memory::new(2, samples, length, &spec(), recurrent.unwrap_or(0));
        let config = PpoConfig { rollout_steps: T, time_limit, ..PpoConfig::default() };
        let mut rollout = Rollout::new(&config, false, &PART, memory(2 * T), policies.states(4));
        let mut both = memory(4 * T);
        let critics = Critics { policies: &policies, units: &units(), threads: &Threads::one() };
        let mut dice = dice(4);
        let watch = &mut Stopwatch::default();
        for step in 0..2 * T {
            rollout.act(critics, &mut dice, &percept(step));
            let experience = Experience {
                rewards: (0..4).map(|row| reward(row, step)).collect(),
                ends: (0..4).map(|row| ends(row, step)).collect(),
                last_obs: Rows::from_vec((0..4).map(|row| shown(row, age(row, step) + 1)).collect(), 1),
                last_masks: None,
            };
            let is_over = rollout.take_in(critics, &experience, watch);
            assert_eq!(is_over, step % T == T - 1);
            if is_over {
                rollout.finish(critics, &percept(step + 1), watch);
                both.take_rollout(step / T, &PART, 2, rollout.memory());
            }
        }
        (both, policies)
    }

    /// What a row goes through in both rollouts and the step after, step by step.
    #[derive(Default)]
    struct Lived {
        values: Vec<f32>,
        /// Value of what the step shows before the next episode begins.
        last_values: Vec<f32>,
        /// Hidden state before the step.
        states: Vec<Vec<f32>>,
    }

    fn lived(policies: &PolicyStack, row: usize) -> Lived {
        let (agent, mut states) = (row / 2, policies.states(2));
        let mut lived = Lived::default();
        for step in 0..=2 * T {
            let value_of = |age: usize, states: &mut States| {
                let obs = Rows::from_vec(vec![shown(row, age); 2], 1);
                policies.judge(0..2, &Threads::one(), &obs, states).rows().nth(agent).unwrap().1
            };
            lived.states.push(states.row(agent).to_vec());
            lived.values.push(value_of(age(row, step), &mut states));
            lived.last_values.push(value_of(age(row, step) + 1, &mut states.clone()));
            if ends(row, step) {
                states = policies.states(2);
            }
        }
        lived
    }

    #[test]
    fn every_decision_is_in_its_slot_with_its_advantage_and_sequences_keep_the_state_that_they_began_in() {
        for (recurrent, time_limit) in
            [(None, TimeLimit::Terminal), (None, TimeLimit::Bootstrap), (Some(3), TimeLimit::Bootstrap)]
        {
            let (memory, policies) = recorded(recurrent, time_limit);
            for row in 0..4 {
                let Lived { values, last_values, states } = lived(&policies, row);
                for rollout in 0..2 {
                    let steps = rollout * T..(rollout + 1) * T;
                    let over: Vec<bool> = steps.clone().map(|step| ends(row, step)).collect();
                    let credited = |step: usize| match ends(row, step) && time_limit == TimeLimit::Bootstrap {
                        true => reward(row, step) + 0.99 * last_values[step],
                        false => reward(row, step),
                    };
                    let rewards: Vec<f32> = steps.clone().map(credited).collect();
                    let expected =
                        advantages(&rewards, &values[steps.clone()], &over, &[values[steps.end]], 0.99, 0.95);
                    for (t, step) in steps.enumerate() {
                        let (agent, slot) = (row / 2, rollout * 8 + row % 2 * T + t);
                        let sample = memory.sample(agent, slot);
                        assert_eq!(memory.obs(agent, slot), [shown(row, age(row, step))], "row {row}, step {step}");
                        assert_eq!(sample.start, age(row, step) == 0);
                        assert!((sample.value - values[step]).abs() < 1e-5);
                        assert!((sample.advantage - expected[t]).abs() < 1e-4, "{sample:?} {}", expected[t]);
                        assert!((sample.ret - sample.advantage - sample.value).abs() < 1e-5);
                        if recurrent.is_some() && slot.is_multiple_of(2) {
                            let kept = memory.state(agent, slot / 2).iter().zip(&states[step]);
                            assert!(kept.into_iter().all(|(a, b)| (a - b).abs() < 1e-6), "row {row}, step {step}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn with_a_shared_bootstrap_the_value_of_the_last_row_stands_for_all() {
        let policies = policies(None);
        let values = |shared| {
            let memory = Memory::new(2, 32, 1, &spec(), 0);
            let rollout = Rollout::new(&PpoConfig::default(), shared, &PART, memory, policies.states(4));
            let critics = Critics { policies: &policies, units: &units(), threads: &Threads::one() };
            rollout.bootstrap(critics, &Rows::from_vec(vec![0.1, 0.2, 0.3, 0.4], 1))
        };
        let own = values(false);
        assert!(own[0] != own[3]);
        assert_eq!(values(true), [own[3]; 4]);
    }
}
