//! Rollouts: T steps of an environment under the policies, written to the memory with their advantages.

use super::environment::{Environment, Experience};
use super::gae::advantages;
use super::stream::{AgentStream, RowStream, rows_of, rows_of_mut};
use crate::config::{PpoConfig, TimeLimit};
use crate::policy::{Memory, PolicyStack, Sample, sampling};
use dials_core::base::{Dice, Phase, Rows, Stopwatch};
use dials_core::domain::{Action, Percept, Result};
use stacknets::States;

/// Returns of the episodes that ended in this period, per agent.
///
/// First episodes that were cut short by staggering do not count.
#[derive(Clone, Debug)]
pub struct EpisodeReturns {
    horizon: usize,
    /// Sum of rewards and number of steps since the episode began, per row.
    running: Vec<(f64, usize)>,
    /// Sum of returns and number of episodes, per agent.
    finished: Vec<(f64, u64)>,
}

impl EpisodeReturns {
    /// Continues the current episodes.
    fn resume(streams: &[AgentStream], horizon: usize) -> Self {
        let running = rows_of(streams).map(|row| (row.rewards, row.trail.steps()));
        EpisodeReturns { horizon, running: running.collect(), finished: vec![(0.0, 0); streams.len()] }
    }

    fn add(&mut self, experience: &Experience) {
        let copies = self.running.len() / self.finished.len();
        for (row, (sum, steps)) in self.running.iter_mut().enumerate() {
            *sum += f64::from(experience.rewards[row]);
            *steps += 1;
            if experience.ends[row] {
                if *steps == self.horizon {
                    let (returns, episodes) = &mut self.finished[row / copies];
                    *returns += *sum;
                    *episodes += 1;
                }
                (*sum, *steps) = (0.0, 0);
            }
        }
    }

    /// Returns the mean return and the number of episodes, per agent. If no episode ended: `None` and 0.
    pub fn means(&self) -> Vec<(Option<f64>, u64)> {
        let mean = |&(sum, episodes): &(f64, u64)| ((episodes > 0).then(|| sum / episodes as f64), episodes);
        self.finished.iter().map(mean).collect()
    }
}

/// Acting state of some agents in training: what continues from one rollout to the next.
pub struct Actor {
    /// Dice for the actions, one per row.
    pub dice: Vec<Dice>,
    /// Hidden states of the policies, one per row.
    pub states: States,
    /// Whether an episode begins with the row's next decision.
    pub starts: Vec<bool>,
    pub returns: EpisodeReturns,
}

impl Actor {
    /// Continues where `streams`, one per agent, left off.
    pub fn resume(policies: &PolicyStack, streams: &[AgentStream], horizon: usize) -> Self {
        let rows: Vec<&RowStream> = rows_of(streams).collect();
        let mut states = policies.states(rows.len());
        rows.iter().enumerate().for_each(|(row, stream)| states.set_row(row, &stream.state));
        Actor {
            dice: rows.iter().map(|row| row.acting.clone()).collect(),
            states,
            starts: rows.iter().map(|row| row.trail.steps() == 0).collect(),
            returns: EpisodeReturns::resume(streams, horizon),
        }
    }

    /// Writes the acting state to the streams.
    pub fn leave(&self, streams: &mut [AgentStream]) {
        let rows = self.dice.iter().zip(&self.returns.running).zip(rows_of_mut(streams));
        for (row, ((dice, (rewards, _)), stream)) in rows.enumerate() {
            stream.acting.clone_from(dice);
            stream.state.copy_from_slice(self.states.row(row));
            stream.rewards = *rewards;
        }
    }
}

/// Agents of one kind that play: their policies, their acting state and their memory.
pub struct KindAtPlay<'a> {
    pub policies: &'a PolicyStack,
    pub actor: &'a mut Actor,
    pub memory: &'a mut Memory,
    /// Whether the value of the last agent stands for what would come for all agents, see `gs.shared_policy`.
    pub shared_bootstrap: bool,
}

impl KindAtPlay<'_> {
    /// Returns the values of these observations, one per row, which stand for what would come. Updates `states`.
    fn bootstrap(&self, obs: &Rows<f32>, states: &mut States) -> Vec<f32> {
        let mut values: Vec<f32> = self.policies.judge(obs, states).rows().map(|(_, value)| value).collect();
        if let (true, Some(&last)) = (self.shared_bootstrap, values.last()) {
            values.fill(last);
        }
        values
    }
}

/// Plays `rollout_steps` steps and writes them to the memories. For every agent they fill the slots from `first_slot`
/// on, copy after copy. `players`: one per kind of the environment.
pub fn roll_out(
    environment: &mut dyn Environment,
    players: &mut [KindAtPlay<'_>],
    first_slot: usize,
    config: &PpoConfig,
    watch: &mut Stopwatch,
) -> Result<()> {
    let rows = |percept: &Percept| percept.obs.len();
    let mut rollouts: Vec<Rollout> =
        environment.percepts().iter().map(|percept| Rollout::new(rows(percept), first_slot, config)).collect();
    for t in 0..config.rollout_steps {
        let actions: Vec<Vec<Action>> = watch.time(Phase::Acting, || {
            let at_play = rollouts.iter_mut().zip(players.iter_mut()).zip(environment.percepts());
            at_play.map(|((rollout, player), percept)| rollout.act(t, player, percept)).collect()
        });
        let experiences = environment.step(&actions, watch)?;
        for ((rollout, player), experience) in rollouts.iter_mut().zip(players.iter_mut()).zip(experiences) {
            rollout.take_in(player, experience, config, watch);
        }
    }
    for ((rollout, player), percept) in rollouts.iter().zip(players).zip(environment.percepts()) {
        rollout.finish(player, percept, config, watch);
    }
    Ok(())
}

/// What a rollout of one kind holds so far.
struct Rollout {
    rows: usize,
    /// Number of steps that it will have.
    steps: usize,
    first_slot: usize,
    /// `[steps so far, rows]`; the same for the values and the ends.
    rewards: Vec<f32>,
    values: Vec<f32>,
    ends: Vec<bool>,
}

impl Rollout {
    fn new(rows: usize, first_slot: usize, config: &PpoConfig) -> Rollout {
        let steps = config.rollout_steps;
        Rollout {
            rows,
            steps,
            first_slot,
            rewards: Vec::with_capacity(steps * rows),
            values: Vec::with_capacity(steps * rows),
            ends: Vec::with_capacity(steps * rows),
        }
    }

    /// Returns the agent of a row, and the slot for its step `t`.
    fn slot(&self, t: usize, row: usize, agents: usize) -> (usize, usize) {
        let copies = self.rows / agents;
        (row / copies, self.first_slot + row % copies * self.steps + t)
    }

    /// Chooses one action per row.
    fn act(&mut self, t: usize, player: &mut KindAtPlay<'_>, percept: &Percept) -> Vec<Action> {
        let KindAtPlay { policies, actor, memory, .. } = player;
        let before = actor.states.clone();
        let judgement = policies.decide(percept, &mut actor.states);
        let mut log_probs = vec![0.0; policies.n_actions()];
        let mut actions = Vec::with_capacity(self.rows);
        for (row, (logits, value)) in judgement.rows().enumerate() {
            sampling::log_softmax(logits, &mut log_probs);
            let action = sampling::draw(&log_probs, &mut actor.dice[row]);
            let (agent, slot) = self.slot(t, row, policies.agents());
            let log_prob = log_probs[usize::from(action)];
            let sample = Sample { action, log_prob, value, start: actor.starts[row], ..Sample::default() };
            memory.remember(agent, slot, percept.obs.row(row), before.row(row), sample);
            if let Some(masks) = &percept.masks {
                memory.remember_mask(agent, slot, masks.row(row));
            }
            actions.push(action);
            self.values.push(value);
        }
        actions
    }

    /// Records what the actions brought.
    fn take_in(
        &mut self,
        player: &mut KindAtPlay<'_>,
        experience: &Experience,
        config: &PpoConfig,
        watch: &mut Stopwatch,
    ) {
        player.actor.returns.add(experience);
        let now = self.rewards.len();
        self.rewards.extend_from_slice(&experience.rewards);
        self.ends.extend_from_slice(&experience.ends);
        if config.time_limit == TimeLimit::Bootstrap && experience.any_end() {
            let rewards = &mut self.rewards[now..];
            watch.time(Phase::Acting, || {
                credit_what_would_come(player, experience, config.gamma as f32, rewards);
            });
        }
        let actor = &mut player.actor;
        actor.starts.copy_from_slice(&experience.ends);
        (0..self.rows).filter(|&row| experience.ends[row]).for_each(|row| actor.states.clear(row));
    }

    /// Writes advantages and returns to the memory. `percept`: what the rows show after the last step.
    fn finish(&self, player: &mut KindAtPlay<'_>, percept: &Percept, config: &PpoConfig, watch: &mut Stopwatch) {
        let last_values =
            watch.time(Phase::Acting, || player.bootstrap(&percept.obs, &mut player.actor.states.clone()));
        let KindAtPlay { policies, memory, .. } = player;
        watch.time(Phase::Bookkeeping, || {
            let (gamma, lambda) = (config.gamma as f32, config.gae_lambda as f32);
            let advantages = advantages(&self.rewards, &self.values, &self.ends, &last_values, gamma, lambda);
            for (i, &advantage) in advantages.iter().enumerate() {
                let (agent, slot) = self.slot(i / self.rows, i % self.rows, policies.agents());
                let sample = memory.sample_mut(agent, slot);
                sample.advantage = advantage;
                sample.ret = advantage + sample.value;
            }
        });
    }
}

/// Adds the discounted value of the last observation to the rewards of the rows whose episode the time limit cut. The
/// value is computed with the policy's hidden state at that step.
///
/// DEVIATION 8: in the authors' code nothing comes after the horizon (`time_limit = "terminal"`). But an agent sees no
/// clock, so its critic cannot know.
fn credit_what_would_come(player: &KindAtPlay<'_>, experience: &Experience, gamma: f32, rewards: &mut [f32]) {
    let values = player.bootstrap(&experience.last_obs, &mut player.actor.states.clone());
    for ((reward, &end), value) in rewards.iter_mut().zip(&experience.ends).zip(values) {
        if end {
            *reward += gamma * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use super::*;
    use crate::config::{Config, PolicyConfig};
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
            let sources = SourceSpec::bits(1);
            let spec = RegionSpec {
                obs_dim: 1,
                d_set_dim: 1,
                n_actions: 2,
                masks: false,
                sources,
                horizon: 3,
                local_horizon: 3,
            };
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
    }

    fn shown(row: usize, age: usize) -> f32 {
        (10 * row + age) as f32
    }

    fn reward(row: usize, age: usize) -> f32 {
        row as f32 + age as f32 / 10.0
    }

    impl Environment for Scripted {
        fn percepts(&self) -> &[Percept] {
            from_ref(&self.percept)
        }

        fn step(&mut self, _actions: &[Vec<Action>], _watch: &mut Stopwatch) -> Result<&[Experience]> {
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
            Ok(from_ref(&self.experience))
        }

        fn leave(&mut self, _streams: &mut [&mut [AgentStream]]) {
            unreachable!("these tests play within one period")
        }
    }

    /// Makes networks whose value is the observation plus, with memory, a part of the state.
    fn policies(recurrent: Option<usize>, spec: &RegionSpec) -> PolicyStack {
        let config = PolicyConfig { recurrent, hidden: vec![4], ..PolicyConfig::default() };
        PolicyStack::new(&AgentId::all(2), spec, &config, &[0.0; 2], Seed::new(6))
    }

    const T: usize = 4;

    /// Returns the streams of two agents with two copies each at the beginning of training.
    fn streams(policies: &PolicyStack) -> Vec<AgentStream> {
        let config: Config = toml::from_str("seed = 7\nlocal_simulators.copies = 2").unwrap();
        AgentId::all(2).into_iter().map(|agent| AgentStream::begin(&config, policies, agent)).collect()
    }

    /// Records two rollouts of four steps in a memory of 16 per agent.
    fn recorded(recurrent: Option<usize>, time_limit: TimeLimit) -> (Memory, PolicyStack) {
        let mut scripted = Scripted::new();
        let policies = policies(recurrent, &scripted.spec);
        let length = if recurrent.is_some() { 2 } else { 1 };
        let mut memory = Memory::new(2, 16, length, &scripted.spec, recurrent.unwrap_or(0));
        let mut actor = Actor::resume(&policies, &streams(&policies), 3);
        let config = PpoConfig { rollout_steps: T, time_limit, ..PpoConfig::default() };
        for first_slot in [0, 8] {
            let watch = &mut Stopwatch::default();
            let player =
                KindAtPlay { policies: &policies, actor: &mut actor, memory: &mut memory, shared_bootstrap: false };
            roll_out(&mut scripted, &mut [player], first_slot, &config, watch).unwrap();
        }
        (memory, policies)
    }

    /// Returns what row `row` goes through, step by step, in both rollouts and the step after: (age, state before).
    fn lived(policies: &PolicyStack, row: usize) -> (Vec<usize>, Vec<f32>, Vec<f32>) {
        let (mut ages, mut values, mut last_values) = (vec![], vec![], vec![]);
        let mut states = policies.states(2);
        let agent = row / 2;
        let mut age = 0;
        for _ in 0..=2 * T {
            let value_of = |age: usize, states: &mut States| {
                let obs = Rows::from_vec(vec![shown(row, age); 2], 1);
                policies.judge(&obs, states).rows().nth(agent).unwrap().1
            };
            ages.push(age);
            values.push(value_of(age, &mut states));
            last_values.push(value_of(age + 1, &mut states.clone()));
            age += 1;
            if row == 1 && age == 3 {
                age = 0;
                states = policies.states(2);
            }
        }
        (ages, values, last_values)
    }

    #[test]
    fn every_decision_is_in_its_slot_with_its_advantage() {
        for (recurrent, time_limit) in
            [(None, TimeLimit::Terminal), (None, TimeLimit::Bootstrap), (Some(3), TimeLimit::Bootstrap)]
        {
            let (memory, policies) = recorded(recurrent, time_limit);
            for row in 0..4 {
                let (ages, values, last_values) = lived(&policies, row);
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
                    }
                }
            }
        }
    }

    #[test]
    fn with_a_shared_bootstrap_the_value_of_the_last_row_stands_for_all() {
        let spec = Scripted::new().spec;
        let policies = policies(None, &spec);
        let mut actor = Actor::resume(&policies, &streams(&policies), 3);
        let mut memory = Memory::new(2, 16, 1, &spec, 0);
        let obs = Rows::from_vec(vec![0.1, 0.2, 0.3, 0.4], 1);
        let mut values = |shared_bootstrap| {
            let player = KindAtPlay { policies: &policies, actor: &mut actor, memory: &mut memory, shared_bootstrap };
            player.bootstrap(&obs, &mut policies.states(4))
        };
        let own = values(false);
        assert!(own[0] != own[3]);
        assert_eq!(values(true), [own[3]; 4]);
    }

    #[test]
    fn a_sequence_keeps_the_state_that_it_began_in() {
        let (memory, policies) = recorded(Some(3), TimeLimit::Terminal);
        for row in 0..4 {
            let mut states = policies.states(2);
            let mut age = 0;
            for step in 0..2 * T {
                let slot = step / T * 8 + row % 2 * T + step % T;
                if slot.is_multiple_of(2) {
                    let kept = memory.state(row / 2, slot / 2);
                    let state = states.row(row / 2);
                    assert!(kept.iter().zip(state).all(|(a, b)| (a - b).abs() < 1e-6), "row {row}, step {step}");
                }
                policies.judge(&Rows::from_vec(vec![shown(row, age); 2], 1), &mut states);
                age += 1;
                if row == 1 && age == 3 {
                    age = 0;
                    states = policies.states(2);
                }
            }
        }
    }

    #[test]
    fn only_whole_episodes_count_as_returns() {
        let mut scripted = Scripted::new();
        let policies = policies(None, &scripted.spec);
        let mut actor = Actor::resume(&policies, &streams(&policies), 3);
        let mut memory = Memory::new(2, 8, 1, &scripted.spec, 0);
        let config = PpoConfig { rollout_steps: T, ..PpoConfig::default() };
        let watch = &mut Stopwatch::default();
        let player =
            KindAtPlay { policies: &policies, actor: &mut actor, memory: &mut memory, shared_bootstrap: false };
        roll_out(&mut scripted, &mut [player], 0, &config, watch).unwrap();
        // Row 1 ends once: 1.0 + 1.1 + 1.2.
        let means = actor.returns.means();
        assert!((means[0].0.unwrap() - 3.3).abs() < 1e-6 && means[0].1 == 1);
        assert_eq!(means[1], (None, 0));
    }
}
