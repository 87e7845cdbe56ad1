//! Rollouts: T decisions of every row, written to the memory with their advantages.

use super::gae::advantages;
use super::memory::{Memory, Sample};
use crate::config::{PpoConfig, TimeLimit};
use crate::environments::Experience;
use crate::policy::{PolicyStack, sampling};
use dials_core::base::{Dice, Phase, Rows, Stopwatch};
use dials_core::domain::{Action, Percept};
use stacknets::States;

/// A rollout under way, and the acting state that goes on from one rollout to the next.
///
/// For every agent, a rollout fills the slots of the memory from `first_slot` on, copy after copy.
pub(super) struct Rollout {
    config: PpoConfig,
    /// Whether the value of the last row stands for what would come for all rows, see `gs.shared_policy`.
    shared_bootstrap: bool,
    /// Hidden states of the policies, one per row.
    pub(crate) states: States,
    /// Whether an episode begins with the row's next decision.
    starts: Vec<bool>,
    first_slot: usize,
    /// `[steps so far, rows]`; the same for the values and the ends.
    rewards: Vec<f32>,
    values: Vec<f32>,
    ends: Vec<bool>,
}

impl Rollout {
    /// Begins the first rollout. `states`: one per row.
    pub(super) fn new(config: &PpoConfig, shared_bootstrap: bool, states: States) -> Rollout {
        Rollout {
            config: config.clone(),
            shared_bootstrap,
            starts: vec![true; states.rows()],
            states,
            first_slot: 0,
            rewards: Vec::new(),
            values: Vec::new(),
            ends: Vec::new(),
        }
    }

    fn rows(&self) -> usize {
        self.starts.len()
    }

    /// Returns the agent of a row, and the slot for its step `t`.
    fn slot(&self, t: usize, row: usize, agents: usize) -> (usize, usize) {
        let copies = self.rows() / agents;
        (row / copies, self.first_slot + row % copies * self.config.rollout_steps + t)
    }

    /// Chooses one action per row, and records the decisions. `dice`: one per row.
    pub(super) fn act(
        &mut self,
        policies: &PolicyStack,
        dice: &mut [Dice],
        memory: &mut Memory,
        percept: &Percept,
    ) -> Vec<Action> {
        let t = self.rewards.len() / self.rows();
        let before = self.states.clone();
        let judgement = policies.decide(percept, &mut self.states);
        let mut log_probs = vec![0.0; policies.n_actions()];
        let mut actions = Vec::with_capacity(self.rows());
        for (row, (logits, value)) in judgement.rows().enumerate() {
            sampling::log_softmax(logits, &mut log_probs);
            let action = sampling::draw(&log_probs, &mut dice[row]);
            let (agent, slot) = self.slot(t, row, policies.agents());
            let log_prob = log_probs[usize::from(action)];
            let sample = Sample { action, log_prob, value, start: self.starts[row], ..Sample::default() };
            let mask = percept.masks.as_ref().map_or(&[][..], |masks| masks.row(row));
            memory.remember(agent, slot, (percept.obs.row(row), mask), before.row(row), sample);
            actions.push(action);
            self.values.push(value);
        }
        actions
    }

    /// Records what the actions brought. Returns whether the rollout has all its steps.
    pub(super) fn take_in(&mut self, policies: &PolicyStack, experience: &Experience, watch: &mut Stopwatch) -> bool {
        let now = self.rewards.len();
        self.rewards.extend_from_slice(&experience.rewards);
        self.ends.extend_from_slice(&experience.ends);
        if self.config.time_limit == TimeLimit::Bootstrap && experience.any_end() {
            watch.time(Phase::Acting, || self.credit_what_would_come(policies, experience, now));
        }
        self.starts.copy_from_slice(&experience.ends);
        (0..self.rows()).filter(|&row| experience.ends[row]).for_each(|row| self.states.clear(row));
        self.rewards.len() == self.config.rollout_steps * self.rows()
    }

    /// Writes advantages and returns to the memory, and begins the next rollout. `next`: what the rows show after the
    /// last step. Returns whether the memory is full.
    pub(super) fn finish(
        &mut self,
        policies: &PolicyStack,
        memory: &mut Memory,
        next: &Percept,
        watch: &mut Stopwatch,
    ) -> bool {
        let last_values = watch.time(Phase::Acting, || self.bootstrap(policies, &next.obs));
        watch.time(Phase::Bookkeeping, || {
            let (gamma, lambda) = (self.config.gamma as f32, self.config.gae_lambda as f32);
            let advantages = advantages(&self.rewards, &self.values, &self.ends, &last_values, gamma, lambda);
            for (i, &advantage) in advantages.iter().enumerate() {
                let (agent, slot) = self.slot(i / self.rows(), i % self.rows(), policies.agents());
                let sample = memory.sample_mut(agent, slot);
                sample.advantage = advantage;
                sample.ret = advantage + sample.value;
            }
        });
        self.rewards.clear();
        self.values.clear();
        self.ends.clear();
        self.first_slot += self.rows() / policies.agents() * self.config.rollout_steps;
        let is_full = self.first_slot == memory.capacity;
        if is_full {
            self.first_slot = 0;
        }
        is_full
    }

    /// Returns the values of these observations, one per row, which stand for what would come.
    fn bootstrap(&self, policies: &PolicyStack, obs: &Rows<f32>) -> Vec<f32> {
        let mut values: Vec<f32> =
            policies.judge(obs, &mut self.states.clone()).rows().map(|(_, value)| value).collect();
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
    fn credit_what_would_come(&mut self, policies: &PolicyStack, experience: &Experience, now: usize) {
        let values = self.bootstrap(policies, &experience.last_obs);
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
    use crate::config::PolicyConfig;
    use crate::fixtures::{dice, region};
    use dials_core::base::{AgentId, Seed};
    use dials_core::domain::{RegionSpec, SourceSpec};

    /// Two agents with two copies each. Row r shows the number 10 r + t at step t of its episode, and its reward is r +
    /// t / 10. The episodes of row 1 end after every third step, the others never.
    struct Scripted {
        spec: RegionSpec,
        ages: [usize; 4],
        percept: Percept,
        experience: Experience,
    }

    impl Scripted {
        fn new() -> Self {
            let spec = region(1, 1, SourceSpec::bits(1), 3);
            let mut scripted =
                Scripted { ages: [0; 4], percept: Percept::new(4, &spec), experience: Experience::new(4, &spec), spec };
            scripted.show();
            scripted
        }

        fn show(&mut self) {
            for (row, age) in self.ages.into_iter().enumerate() {
                self.percept.obs.row_mut(row)[0] = shown(row, age);
            }
        }

        fn step(&mut self) {
            for row in 0..4 {
                self.experience.rewards[row] = reward(row, self.ages[row]);
                self.ages[row] += 1;
                self.experience.ends[row] = row == 1 && self.ages[row] == 3;
                if self.experience.ends[row] {
                    self.experience.last_obs.row_mut(row)[0] = shown(row, self.ages[row]);
                    self.ages[row] = 0;
                }
            }
            self.show();
        }
    }

    fn shown(row: usize, age: usize) -> f32 {
        (10 * row + age) as f32
    }

    fn reward(row: usize, age: usize) -> f32 {
        row as f32 + age as f32 / 10.0
    }

    /// Makes networks whose value is the observation plus, with memory, a part of the state.
    fn policies(recurrent: Option<usize>, spec: &RegionSpec) -> PolicyStack {
        let config = PolicyConfig { recurrent, hidden: vec![4], ..PolicyConfig::default() };
        PolicyStack::new(&AgentId::all(2), spec, &config, &[0.0; 2], Seed::new(6))
    }

    const T: usize = 4;

    /// Begins the rollouts of two agents with two copies each.
    fn begun(policies: &PolicyStack, config: &PpoConfig, shared_bootstrap: bool) -> Rollout {
        Rollout::new(config, shared_bootstrap, policies.states(4))
    }

    /// Records two rollouts of four steps in a memory of 16 per agent.
    fn recorded(recurrent: Option<usize>, time_limit: TimeLimit) -> (Memory, PolicyStack) {
        let mut scripted = Scripted::new();
        let policies = policies(recurrent, &scripted.spec);
        let length = if recurrent.is_some() { 2 } else { 1 };
        let mut memory = Memory::new(2, 16, length, &scripted.spec, recurrent.unwrap_or(0));
        let config = PpoConfig { rollout_steps: T, time_limit, ..PpoConfig::default() };
        let mut rollout = begun(&policies, &config, false);
        let mut dice = dice(4);
        let watch = &mut Stopwatch::default();
        for is_last in [false, true] {
            for t in 1..=T {
                rollout.act(&policies, &mut dice, &mut memory, &scripted.percept);
                scripted.step();
                assert_eq!(rollout.take_in(&policies, &scripted.experience, watch), t == T);
            }
            assert_eq!(rollout.finish(&policies, &mut memory, &scripted.percept, watch), is_last);
        }
        (memory, policies)
    }

    /// What a row goes through in both rollouts and the step after, step by step.
    #[derive(Default)]
    struct Lived {
        ages: Vec<usize>,
        values: Vec<f32>,
        /// Value of what the step shows before the next episode begins.
        last_values: Vec<f32>,
        /// Hidden state before the step.
        states: Vec<Vec<f32>>,
    }

    fn lived(policies: &PolicyStack, row: usize) -> Lived {
        let (agent, mut age, mut states) = (row / 2, 0, policies.states(2));
        let mut lived = Lived::default();
        for _ in 0..=2 * T {
            let value_of = |age: usize, states: &mut States| {
                let obs = Rows::from_vec(vec![shown(row, age); 2], 1);
                policies.judge(&obs, states).rows().nth(agent).unwrap().1
            };
            lived.ages.push(age);
            lived.states.push(states.row(agent).to_vec());
            lived.values.push(value_of(age, &mut states));
            lived.last_values.push(value_of(age + 1, &mut states.clone()));
            age += 1;
            if row == 1 && age == 3 {
                (age, states) = (0, policies.states(2));
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
                let Lived { ages, values, last_values, states } = lived(&policies, row);
                for rollout in 0..2 {
                    let steps = rollout * T..(rollout + 1) * T;
                    let ends: Vec<bool> = steps.clone().map(|t| row == 1 && ages[t] == 2).collect();
                    let rewards = steps.clone().zip(&ends).map(|(t, &end)| {
                        let credit =
                            if end && time_limit == TimeLimit::Bootstrap { 0.99 * last_values[t] } else { 0.0 };
                        reward(row, ages[t]) + credit
                    });
                    let rewards: Vec<f32> = rewards.collect();
                    let expected =
                        advantages(&rewards, &values[steps.clone()], &ends, &[values[steps.end]], 0.99, 0.95);
                    for (t, step) in steps.enumerate() {
                        let (agent, slot) = (row / 2, rollout * 8 + row % 2 * T + t);
                        let sample = memory.sample(agent, slot);
                        assert_eq!(memory.obs(agent, slot), [shown(row, ages[step])], "row {row}, step {step}");
                        assert_eq!(sample.start, ages[step] == 0);
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
        let spec = Scripted::new().spec;
        let policies = policies(None, &spec);
        let obs = Rows::from_vec(vec![0.1, 0.2, 0.3, 0.4], 1);
        let values = |shared| begun(&policies, &PpoConfig::default(), shared).bootstrap(&policies, &obs);
        let own = values(false);
        assert!(own[0] != own[3]);
        assert_eq!(values(true), [own[3]; 4]);
    }
}
