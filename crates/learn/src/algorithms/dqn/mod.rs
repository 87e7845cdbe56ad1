//! Deep Q-learning (DQN): values of actions, learnt from a replay of single decisions.
//!
//! - `config`: the table `[dqn]`. `replay`: what agents remember. `values`: values of actions, and the loss.
//!
//! Outputs of the networks are those of PPO's policies, one per action and one for the state, so the same stacks, files
//! and exports hold them. The greedy action is played in evaluations.
//!
//! Source: Mnih et al. 2015; double: van Hasselt et al. 2016; dueling: Wang et al. 2016; prioritised: Schaul et al. 2016.

mod config;
mod replay;
mod values;

use std::ops::Range;
use std::time::Instant;

use rand::Rng;
use rand::seq::IteratorRandom;

use super::ppo::TimeLimit;
use super::tables::Base;
use super::{Actor, Algorithm, Layout, Learner, Metrics, NumberTable, Tables};
use crate::config::Config;
use crate::environments::Experience;
use crate::policy::{PolicyStack, Reading};
use crate::state::stream::Part;
pub use config::DqnConfig;
use dials_core::base::{AgentId, Dice, Phase, Rows, Stopwatch};
use dials_core::domain::{Action, Kind, Percept, RegionSpec, Result};
use replay::{Decision, Replay, width};
use stacknets::{Network, Sequences, Shape, Threads, Trace};
use values::{action_values, add_gradient, best_action, huber};

/// Names of its own tables, as in checkpoints.
const TARGET: &str = "target";
const REPLAY: &str = "replay";
const STEPS: &str = "steps";

/// Priority that is added to every error, so that no decision is forgotten.
const LEAST_PRIORITY: f32 = 1e-3;

impl DqnConfig {
    /// Returns the number of gradient steps after this number of timesteps per agent.
    fn gradient_steps_until(&self, steps: u64) -> u64 {
        let every = self.update_every_steps as u64;
        let before = self.learning_starts.div_ceil(every).saturating_sub(1);
        (steps / every).saturating_sub(before).saturating_mul(self.gradient_steps as u64)
    }

    /// Returns the share of random actions at this timestep per agent.
    fn epsilon_at(&self, steps: u64) -> f64 {
        let done = (steps as f64 / self.epsilon_steps as f64).min(1.0);
        self.epsilon + (self.final_epsilon - self.epsilon) * done
    }
}

impl Algorithm for DqnConfig {
    fn check(&self, config: &Config) -> Result<()> {
        DqnConfig::check(self, config)
    }

    fn updates(&self) -> (&'static str, u64) {
        ("dqn.update_every_steps", self.update_every_steps as u64)
    }

    fn reading(&self) -> Reading {
        Reading::Greedy
    }

    fn learner(
        &self,
        config: &Config,
        spec: &RegionSpec,
        agents: &[AgentId],
        stack: PolicyStack,
        parts: &[Part],
    ) -> Box<dyn Learner> {
        Box::new(Dqn::new(self, config, spec, agents, stack, parts))
    }

    fn layout(&self, config: &Config, kind: &Kind, steps: u64) -> Layout {
        let parameters = PolicyStack::shape(&kind.spec, &config.policy).layout().width();
        let decisions = steps.min(self.replay as u64) as usize;
        let mut layout = Base::layout(config, parameters, self.gradient_steps_until(steps));
        let target = NumberTable { name: TARGET, ..layout.numbers[0] };
        let width = decisions * width(&kind.spec);
        layout.numbers.extend([target, NumberTable { name: REPLAY, width, averaged: false, learnt: false, ..target }]);
        layout.counts.push((STEPS, steps));
        layout
    }

    fn learning_rate_key(&self, _config: &Config, _steps: u64) -> &'static str {
        "dqn.learning_rate"
    }

    fn flops_per_step(&self, _config: &Config, shape: &Shape, _horizon: usize) -> f64 {
        let samples = (self.gradient_steps * self.minibatch) as f64 / self.update_every_steps as f64;
        // The network and the target network value what follows; without double Q-learning, only the second does.
        let forward = if self.double { 3.0 } else { 2.0 };
        shape.forward_flops() + samples * (forward * shape.forward_flops() + shape.backward_flops(1))
    }
}

pub(crate) struct Dqn {
    config: DqnConfig,
    policies: PolicyStack,
    target: PolicyStack,
    base: Base,
    replay: Replay,
    /// The last decisions of each lane.
    decided: Vec<Decided>,
    steps: u64,
}

/// The last decisions of a lane: what they answered, and what they brought.
struct Decided {
    agents: Range<usize>,
    obs: Rows<f32>,
    actions: Vec<Action>,
    experience: Experience,
    next: Percept,
}

/// Acts in a lane.
struct DqnActor<'a> {
    policies: &'a PolicyStack,
    threads: &'a Threads,
    epsilon: f64,
    decided: &'a mut Decided,
    /// One per row.
    dice: &'a mut [Dice],
}

impl Actor for DqnActor<'_> {
    fn act(&mut self, percept: &Percept) -> Vec<Action> {
        let judgement = self.policies.decide(
            self.decided.agents.clone(),
            self.threads,
            percept,
            &mut self.policies.states(self.dice.len()),
        );
        for (row, ((logits, _), dice)) in judgement.rows().zip(&mut *self.dice).enumerate() {
            let allowed = |&action: &usize| percept.masks.as_ref().is_none_or(|masks| masks.row(row)[action]);
            self.decided.actions[row] = if dice.random_bool(self.epsilon) {
                (0..logits.len()).filter(allowed).choose(dice).unwrap_or(0) as Action
            } else {
                dials_core::domain::sampling::most_probable(logits)
            };
        }
        self.decided.obs.copy_from(&percept.obs);
        self.decided.actions.clone()
    }

    fn take_in(&mut self, experience: &Experience, next: &Percept, watch: &mut Stopwatch) {
        watch.time(Phase::Bookkeeping, || {
            self.decided.experience.clone_from(experience);
            self.decided.next.clone_from(next);
        });
    }
}

impl Dqn {
    fn new(
        own: &DqnConfig,
        config: &Config,
        spec: &RegionSpec,
        agents: &[AgentId],
        policies: PolicyStack,
        parts: &[Part],
    ) -> Dqn {
        let base = Base::new(config, agents, policies.parameters(), parts);
        let decided = |part: &Part| Decided {
            agents: part.agents.clone(),
            obs: Rows::new(part.rows(), spec.obs_dim),
            actions: vec![0; part.rows()],
            experience: Experience::new(part.rows(), spec),
            next: Percept::new(part.rows(), spec),
        };
        let mut target = PolicyStack::blank(agents.len(), spec, &config.policy);
        target.load(policies.parameters().values());
        Dqn {
            config: own.clone(),
            target,
            replay: Replay::new(agents.len(), own.replay, spec),
            decided: parts.iter().map(decided).collect(),
            base,
            policies,
            steps: 0,
        }
    }

    /// Writes down what the last actions brought, copy after copy.
    fn remember(&mut self) {
        let priority = if self.config.prioritised { 1.0 } else { 0.0 };
        let places: Vec<(usize, usize)> = self.base.places().collect();
        let Dqn { replay, decided, config, policies, .. } = self;
        let copies = places.len() / policies.agents();
        for copy in 0..copies {
            let decision = |agent: usize| {
                let (part, row) = places[agent * copies + copy];
                let Decided { obs, actions, experience, next, .. } = &decided[part];
                let over = experience.ends[row];
                let masks = if over { &experience.last_masks } else { &next.masks };
                let ends = over && config.time_limit == TimeLimit::Terminal;
                Decision {
                    obs: obs.row(row),
                    action: actions[row],
                    reward: experience.rewards[row],
                    next_obs: if over { experience.last_obs.row(row) } else { next.obs.row(row) },
                    discount: if ends { 0.0 } else { config.gamma as f32 },
                    next_mask: masks.as_ref().map(|masks| masks.row(row)),
                }
            };
            replay.push((0..policies.agents()).map(decision), priority);
        }
    }

    fn update(&mut self, watch: &mut Stopwatch) -> Metrics {
        let Dqn { config, policies, target, replay, base: Base { adam, minibatches, .. }, .. } = self;
        let threads = policies.net.threads().clone();
        let learners = policies.learners(adam, config.gradient_steps as u32);
        let begun = Instant::now();
        let agents = learners.into_iter().zip(minibatches).enumerate().collect();
        let (of_replay, of_target) = (&*replay, &*target);
        let done = threads.map(agents, 2, |batch: &mut Minibatch, (agent, (mut learner, dice))| {
            let mut of_agent = OfAgent::default();
            for _ in 0..config.gradient_steps {
                of_agent.watch.time(Phase::Bookkeeping, || batch.draw(config, of_replay, agent, dice));
                of_agent.watch.time(Phase::Forward, || {
                    batch.find_targets(config, learner.network(), of_target.net.network(agent));
                    let (loss, value) = batch.compare(config, learner.network());
                    of_agent.loss += f64::from(loss) / config.gradient_steps as f64;
                    of_agent.value += f64::from(value) / config.gradient_steps as f64;
                });
                of_agent.watch.time(Phase::Backward, || {
                    learner.network().backward(&batch.gradient, &mut batch.trace);
                    if let Some(most) = config.max_gradient_norm {
                        batch.trace.shorten_gradient(most);
                    }
                });
                of_agent.watch.time(Phase::Adam, || learner.descend(batch.trace.gradient(), config.learning_rate));
                of_agent.errors.extend(batch.slots.iter().copied().zip(batch.errors.iter().copied()));
            }
            of_agent
        });
        let mut phases = Stopwatch::default();
        done.iter().for_each(|of_agent| phases.add(&of_agent.watch));
        watch.add(&phases.scaled_to(begun.elapsed()));
        if self.config.prioritised {
            for (agent, of_agent) in done.iter().enumerate() {
                for &(slot, error) in &of_agent.errors {
                    let priority = (error.abs() + LEAST_PRIORITY).powf(self.config.priority_exponent as f32);
                    self.replay.set_priority(agent, slot, priority);
                }
            }
        }
        self.metrics(done.iter().map(|of_agent| (of_agent.loss, of_agent.value)))
    }

    fn metrics(&self, losses: impl Iterator<Item = (f64, f64)>) -> Metrics {
        let (losses, values) = losses.unzip();
        Metrics {
            of_agents: vec![("td_loss".to_owned(), losses), ("action_value".to_owned(), values)],
            settings: vec![
                ("learning_rate".to_owned(), self.config.learning_rate),
                ("epsilon".to_owned(), self.config.epsilon_at(self.steps)),
            ],
        }
    }
}

/// What the gradient steps of one agent in an update brought.
#[derive(Default)]
struct OfAgent {
    loss: f64,
    value: f64,
    errors: Vec<(usize, f32)>,
    watch: Stopwatch,
}

/// A minibatch of one agent, and working memory.
#[derive(Default)]
struct Minibatch {
    slots: Vec<usize>,
    obs: Vec<f32>,
    next_obs: Vec<f32>,
    actions: Vec<Action>,
    rewards: Vec<f32>,
    discounts: Vec<f32>,
    /// `[batch, n_actions]`; empty without masks.
    next_masks: Vec<f32>,
    /// Weights that correct for drawing by priority.
    weights: Vec<f32>,
    trace: Trace,
    /// Actions that the network would choose next; empty if the target network chooses.
    chosen: Vec<usize>,
    targets: Vec<f32>,
    errors: Vec<f32>,
    gradient: Vec<f32>,
}

impl Minibatch {
    fn draw(&mut self, config: &DqnConfig, replay: &Replay, agent: usize, dice: &mut Dice) {
        self.weights.clear();
        if config.prioritised {
            let (slots, probabilities) = replay.draw_by_priority(agent, config.minibatch, dice);
            let weight = |p: f64| (1.0 / (replay.len() as f64 * p)).powf(config.importance_exponent) as f32;
            self.weights.extend(probabilities.into_iter().map(weight));
            let largest = self.weights.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
            self.weights.iter_mut().for_each(|weight| *weight /= largest);
            self.slots = slots;
        } else {
            self.weights.resize(config.minibatch, 1.0);
            self.slots = replay.draw(config.minibatch, dice);
        }
        self.obs.clear();
        self.next_obs.clear();
        self.actions.clear();
        self.rewards.clear();
        self.discounts.clear();
        self.next_masks.clear();
        for &slot in &self.slots {
            let decision = replay.read(agent, slot);
            self.obs.extend_from_slice(decision.obs);
            self.next_obs.extend_from_slice(decision.next_obs);
            self.actions.push(decision.action);
            self.rewards.push(decision.reward);
            self.discounts.push(decision.discount);
            self.next_masks.extend_from_slice(decision.next_mask);
        }
    }

    /// Computes `r + gamma Q_target(s', a')`, where `a'` is the best next action by the network (double) or by the
    /// target network itself.
    fn find_targets(&mut self, config: &DqnConfig, network: Network<'_>, target: Network<'_>) {
        let batch = self.slots.len();
        let mask_width = self.next_masks.len() / batch;
        let mask = |sample: usize| &self.next_masks[sample * mask_width..][..mask_width];
        self.chosen.clear();
        if config.double {
            network.forward(&self.next_obs, Sequences::NONE, &mut self.trace);
            let width = self.trace.output().len() / batch;
            let outputs = self.trace.output().chunks_exact(width);
            // The best action is the one with the best advantage.
            self.chosen.extend(outputs.enumerate().map(|(sample, row)| best_action(&row[..width - 1], mask(sample))));
        }
        target.forward(&self.next_obs, Sequences::NONE, &mut self.trace);
        let width = self.trace.output().len() / batch;
        let mut values = vec![0.0; width - 1];
        self.targets.clear();
        for (sample, row) in self.trace.output().chunks_exact(width).enumerate() {
            action_values(row, config.dueling, &mut values);
            let next = self.chosen.get(sample).copied().unwrap_or_else(|| best_action(&values, mask(sample)));
            self.targets.push(self.rewards[sample] + self.discounts[sample] * values[next]);
        }
    }

    /// Compares the values of the actions with their targets, and writes the gradient of the mean loss. Returns the
    /// means of the losses and of the values.
    fn compare(&mut self, config: &DqnConfig, network: Network<'_>) -> (f32, f32) {
        let batch = self.slots.len();
        network.forward(&self.obs, Sequences::NONE, &mut self.trace);
        let width = self.trace.output().len() / batch;
        let mut values = vec![0.0; width - 1];
        self.gradient.clear();
        self.gradient.resize(batch * width, 0.0);
        self.errors.clear();
        let (mut losses, mut of_actions) = (0.0, 0.0);
        let rows = self.trace.output().chunks_exact(width).zip(self.gradient.chunks_exact_mut(width));
        for (sample, (row, gradient)) in rows.enumerate() {
            action_values(row, config.dueling, &mut values);
            let action = usize::from(self.actions[sample]);
            let error = values[action] - self.targets[sample];
            let (loss, slope) = huber(error);
            let weight = self.weights[sample] / batch as f32;
            add_gradient(weight * slope, action, config.dueling, gradient);
            self.errors.push(error);
            losses += weight * loss;
            of_actions += values[action] / batch as f32;
        }
        (losses, of_actions)
    }
}

impl Learner for Dqn {
    fn policies(&self) -> &PolicyStack {
        &self.policies
    }

    fn policies_mut(&mut self) -> &mut PolicyStack {
        &mut self.policies
    }

    fn actors<'a>(&'a mut self, threads: &'a Threads) -> Vec<Box<dyn Actor + 'a>> {
        let epsilon = self.config.epsilon_at(self.steps);
        let Dqn { policies, decided, base, .. } = self;
        let lanes = decided.iter_mut().zip(&mut base.acting);
        lanes.map(|(decided, dice)| Box::new(DqnActor { policies, threads, epsilon, decided, dice }) as _).collect()
    }

    fn learn(&mut self, steps: u64, watch: &mut Stopwatch) -> Result<Option<Metrics>> {
        watch.time(Phase::Bookkeeping, || self.remember());
        let before = std::mem::replace(&mut self.steps, steps);
        let due = steps.is_multiple_of(self.config.update_every_steps as u64) && steps >= self.config.learning_starts;
        let metrics = due.then(|| self.update(watch));
        if steps / self.config.target_every_steps > before / self.config.target_every_steps {
            self.target.load(self.policies.parameters().values());
        }
        Ok(metrics)
    }

    fn no_metrics(&self) -> Metrics {
        self.metrics((0..self.policies.agents()).map(|_| (0.0, 0.0)))
    }

    fn tables(&self) -> Tables {
        let mut tables = self.base.tables();
        tables.numbers.insert(TARGET.to_owned(), self.target.parameters().values().clone().into());
        tables.numbers.insert(REPLAY.to_owned(), self.replay.table());
        tables.counts.insert(STEPS.to_owned(), self.steps);
        tables
    }

    fn load(&mut self, mut tables: Tables) {
        self.base.load(&mut tables);
        self.target.load(&tables.take_numbers(TARGET).into_rows());
        self.steps = tables.counts[STEPS];
        self.replay.load(&tables.take_numbers(REPLAY), self.steps);
    }
}
