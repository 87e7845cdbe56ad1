//! Rollouts: T steps of an environment under the policies, written to the memory with their advantages.

use super::environment::{Environment, Experience};
use super::gae::advantages;
use crate::base::{Dice, Phase, Stopwatch};
use crate::config::{PpoConfig, TimeLimit};
use crate::domain::{Action, Result};
use crate::policy::{Memory, PolicyStack, Sample, sampling};

/// Returns of the episodes that ended while the policies trained, per agent.
///
/// Episodes that a period or staggering cut short do not count.
#[derive(Clone, Debug)]
pub struct EpisodeReturns {
    horizon: usize,
    /// Sum of rewards and steps so far, per row.
    running: Vec<(f64, usize)>,
    /// Sum of returns and number of episodes, per agent.
    finished: Vec<(f64, u64)>,
}

impl EpisodeReturns {
    pub fn new(agents: usize, copies: usize, horizon: usize) -> Self {
        EpisodeReturns { horizon, running: vec![(0.0, 0); agents * copies], finished: vec![(0.0, 0); agents] }
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

    /// Mean return and number of episodes, per agent; no mean where no episode ended.
    pub fn means(&self) -> Vec<(Option<f64>, u64)> {
        let mean = |&(sum, episodes): &(f64, u64)| ((episodes > 0).then(|| sum / episodes as f64), episodes);
        self.finished.iter().map(mean).collect()
    }
}

/// Plays `rollout_steps` steps and writes them to the memory's slots from `first_slot` on, `rollout_steps` x copies of
/// each agent. `dice`: one per row, for its actions.
#[allow(clippy::too_many_arguments, reason = "all of them are the caller's state; a struct would only rename them")]
pub fn roll_out(
    environment: &mut dyn Environment,
    policies: &PolicyStack,
    memory: &mut Memory,
    first_slot: usize,
    dice: &mut [Dice],
    config: &PpoConfig,
    returns: &mut EpisodeReturns,
    watch: &mut Stopwatch,
) -> Result<()> {
    let (rows, steps) = (environment.rows(), config.rollout_steps);
    let copies = rows / policies.agents();
    let slot = |t: usize, row: usize| (row / copies, first_slot + t * copies + row % copies);
    let mut rewards = Vec::with_capacity(steps * rows);
    let mut values = Vec::with_capacity(steps * rows);
    let mut ends = Vec::with_capacity(steps * rows);
    let mut actions: Vec<Action> = vec![0; rows];
    for t in 0..steps {
        watch.time(Phase::Acting, || {
            let judgement = policies.judge(&environment.percept().obs);
            let mut log_probs = vec![0.0; policies.n_actions()];
            for (row, (logits, value)) in judgement.rows().enumerate() {
                sampling::log_softmax(logits, &mut log_probs);
                let action = sampling::draw(&log_probs, &mut dice[row]);
                let (agent, slot) = slot(t, row);
                let log_prob = log_probs[usize::from(action)];
                let sample = Sample { action, log_prob, value, ..Sample::default() };
                memory.remember(agent, slot, environment.percept().obs.row(row), sample);
                actions[row] = action;
                values.push(value);
            }
        });
        let experience = environment.step(&actions, watch)?;
        returns.add(experience);
        rewards.extend_from_slice(&experience.rewards);
        ends.extend_from_slice(&experience.ends);
        if config.time_limit == TimeLimit::Bootstrap && experience.any_end() {
            let reward = &mut rewards[t * rows..];
            watch.time(Phase::Acting, || credit_what_would_come(policies, experience, config.gamma as f32, reward));
        }
    }
    let last_values: Vec<f32> = watch
        .time(Phase::Acting, || policies.judge(&environment.percept().obs).rows().map(|(_, value)| value).collect());
    watch.time(Phase::Learning, || {
        let (gamma, lambda) = (config.gamma as f32, config.gae_lambda as f32);
        let advantages = advantages(&rewards, &values, &ends, &last_values, gamma, lambda);
        for (i, &advantage) in advantages.iter().enumerate() {
            let (agent, slot) = slot(i / rows, i % rows);
            let sample = memory.sample_mut(agent, slot);
            sample.advantage = advantage;
            sample.ret = advantage + sample.value;
        }
    });
    Ok(())
}

/// Adds the discounted value of the last observation to the rewards of the rows whose episode the time limit cut.
fn credit_what_would_come(policies: &PolicyStack, experience: &Experience, gamma: f32, rewards: &mut [f32]) {
    let judgement = policies.judge(&experience.last_obs);
    for ((reward, &end), (_, value)) in rewards.iter_mut().zip(&experience.ends).zip(judgement.rows()) {
        if end {
            *reward += gamma * value;
        }
    }
}
