//! The update of all agents' policies from a memory, by the loss of [`super::loss`].
//!
//! Source: Schulman et al. 2017; constants: DIALS paper, appendix "Hyperparameters". As in the authors' code, learning
//! rate and clip decay linearly, to 1e-10 and 1e-5, over the total steps, unless the config says otherwise. Every agent
//! learns as if alone.

use std::ops::Range;
use std::time::Instant;

use rand::seq::SliceRandom;

use super::loss::{Losses, Outputs, Spread, Weights, loss_and_gradient};
use super::memory::{Memory, Sample};
use super::value_unit::{Unit, ValueUnits};
use crate::config::{NormaliseAdvantages, PpoConfig};
use crate::policy::PolicyStack;
use dials_core::base::{Dice, Phase, Stopwatch};
use stacknets::{Adam, Sequences, Trace, Trainer};

/// The two settings that decay over a run.
///
/// DEVIATION 20: the weight of the entropy bonus does not. In one version of the authors' code it falls to 1e-5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decayed {
    pub learning_rate: f64,
    pub clip: f64,
}

impl Decayed {
    /// Returns their values after the share `done` of the total steps.
    pub(crate) fn at(config: &PpoConfig, done: f64) -> Self {
        let decay = |decays: bool, from: f64, to: f64| {
            if decays { from + (to - from) * done.clamp(0.0, 1.0) } else { from }
        };
        Decayed {
            learning_rate: decay(config.anneal_learning_rate, config.learning_rate, 1e-10),
            clip: decay(config.anneal_clip, config.clip, 1e-5),
        }
    }
}

/// The part of the networks that an update changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Learns {
    Everything,
    /// The critic alone: what only the value depends on. Its loss is not clipped. The clip would keep a critic that
    /// begins at random from moving further than the clip range per update.
    Critic,
}

#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    pub ppo: &'a PpoConfig,
    /// One per agent.
    pub units: &'a ValueUnits,
    pub decayed: Decayed,
    pub learns: Learns,
    /// Whether all agents of the stack have one policy, see [`update`].
    pub shared: bool,
}

/// Updates all policies of the stack from the memory. Returns the mean losses of each agent over the update.
///
/// `dice`: one per agent, for its minibatches. Every agent makes all of its gradient steps before the next agent
/// begins. If the policies are shared, the first agent learns from the samples of all agents, in minibatches of the
/// same size, and the others copy its policy and its optimiser. If policy and value are towers of their own, and no limit joins
/// their gradients, two threads train one of them each, with the same bits.
pub fn update(
    policies: &mut PolicyStack,
    adam: &mut Adam,
    memory: &Memory,
    dice: &mut [Dice],
    settings: Settings<'_>,
    watch: &mut Stopwatch,
) -> Vec<Losses> {
    let all = policies.agents();
    let (learning, taught) = if settings.shared { (1, all) } else { (all, 1) };
    let steps = settings.ppo.epochs * taught * (memory.capacity / settings.ppo.minibatch);
    let only = (settings.learns == Learns::Critic).then(|| policies.only_critic());
    let threads = policies.net.threads().clone();
    let apart = settings.shared && threads.count() > 1 && settings.ppo.towers_learn_alone();
    let learners = policies.learners(adam, steps as u32);
    let mut tasks = Vec::new();
    for (agent, (learner, dice)) in learners.into_iter().zip(&*dice).enumerate().take(learning) {
        let agents = agent..agent + taught;
        let towers = if apart { learner.towers() } else { vec![learner] };
        let outputs = if towers.len() > 1 { &[Outputs::Logits, Outputs::Value][..] } else { &[Outputs::All] };
        let (mut parameters, mut states) = (0, 0);
        for (learner, &outputs) in towers.into_iter().zip(outputs) {
            let (width, state_width) = (learner.values().len(), learner.network().state_width());
            let only = only.as_deref().map(|only| &only[parameters..parameters + width]);
            let states_of = states..states + state_width;
            (parameters, states) = (parameters + width, states + state_width);
            tasks.push(Task { learner, outputs, states: states_of, agents: agents.clone(), dice: dice.clone(), only });
        }
    }
    let begun = Instant::now();
    let done = threads.map(tasks, 2, |room: &mut UpdateBuffers, task| room.learn(task, memory, settings));
    let (mut phases, mut losses) = (Stopwatch::default(), vec![Losses::default(); learning]);
    for Done { agent, losses: of_task, spent, dice: after } in done {
        losses[agent].add(&of_task, 1.0);
        phases.add(&spent);
        // Towers of one network draw the same.
        dice[agent] = after;
    }
    watch.add(&phases.scaled_to(begun.elapsed()));
    if settings.shared {
        policies.net.spread_first();
        adam.spread_first();
    }
    losses.into_iter().flat_map(|losses| vec![losses; taught]).collect()
}

/// All gradient steps of a learner, or of one tower of it.
struct Task<'a> {
    learner: Trainer<'a>,
    /// What the learner puts out.
    outputs: Outputs,
    /// Its columns of the hidden states.
    states: Range<usize>,
    /// Those whose memories it learns from.
    agents: Range<usize>,
    /// For its minibatches.
    dice: Dice,
    /// Which parameters change; `None` for all.
    only: Option<&'a [bool]>,
}

/// What came of a task.
struct Done {
    /// The first agent of the task.
    agent: usize,
    /// Means over all gradient steps.
    losses: Losses,
    spent: Stopwatch,
    /// The dice after the last minibatch was drawn.
    dice: Dice,
}

#[derive(Default)]
struct UpdateBuffers {
    minibatch: Minibatch,
    trace: Trace,
    /// Gradient of the loss by the outputs of the network.
    gradient: Vec<f32>,
}

impl UpdateBuffers {
    /// Makes all gradient steps of a task.
    fn learn(&mut self, task: Task<'_>, memory: &Memory, settings: Settings<'_>) -> Done {
        let Task { mut learner, outputs, states, agents, mut dice, only } = task;
        let Settings { ppo, units, decayed, .. } = settings;
        let unit = units.of(agents.start);
        let clip = decayed.clip as f32;
        let weights = Weights {
            clip,
            value_clip: if only.is_some() || !ppo.clip_value { f32::INFINITY } else { clip },
            value: ppo.value_coefficient as f32,
            entropy: ppo.entropy as f32,
        };
        let UpdateBuffers { minibatch, trace, gradient } = self;
        let (mut losses, mut watch) = (Losses::default(), Stopwatch::default());
        let gradient_steps = ppo.epochs * agents.len() * (memory.capacity / ppo.minibatch);
        let advantages = agents.clone().flat_map(|agent| memory.samples(agent)).map(|sample| sample.advantage);
        let spread = match ppo.normalise_advantages {
            NormaliseAdvantages::Minibatch => None,
            NormaliseAdvantages::Memory => Some(Spread::of(advantages)),
            NormaliseAdvantages::No => Some(Spread { mean: 0.0, deviation: unit.spread }),
        };
        let mut order: Vec<(usize, usize)> =
            agents.clone().flat_map(|agent| (0..memory.sequences()).map(move |sequence| (agent, sequence))).collect();
        for _ in 0..ppo.epochs {
            order.shuffle(&mut dice);
            for sequences in order.chunks_exact(ppo.minibatch / memory.length) {
                watch.time(Phase::Bookkeeping, || {
                    minibatch.gather(memory, sequences, states.clone());
                    minibatch.bring_to(unit, spread);
                });
                watch.time(Phase::Forward, || {
                    learner.network().forward(&minibatch.obs, minibatch.sequences(), trace);
                    gradient.resize(trace.output().len(), 0.0);
                    let put_out = (outputs, trace.output());
                    let of_batch = loss_and_gradient(put_out, &minibatch.masks, &minibatch.samples, weights, gradient);
                    losses.add(&of_batch, 1.0 / gradient_steps as f64);
                });
                watch.time(Phase::Backward, || learner.network().backward(gradient, trace));
                if let Some(only) = only {
                    // Without a gradient Adam leaves a parameter as it is.
                    let frozen = trace.gradient_mut().iter_mut().zip(only).filter(|(_, learns)| !**learns);
                    frozen.for_each(|(slope, _)| *slope = 0.0);
                }
                if let Some(most) = ppo.max_gradient_norm {
                    watch.time(Phase::Backward, || trace.shorten_gradient(most));
                }
                watch.time(Phase::Adam, || learner.descend(trace.gradient(), decayed.learning_rate));
            }
        }
        // Reports have the unit of the reward.
        losses.value *= f64::from(unit.spread).powi(2);
        Done { agent: agents.start, losses, spent: watch, dice }
    }
}

/// Some sequences of the memory; rows are ordered by step, then by sequence.
#[derive(Default)]
struct Minibatch {
    length: usize,
    obs: Vec<f32>,
    /// `[rows, n_actions]`; empty if the kind has no masks.
    masks: Vec<bool>,
    samples: Vec<Sample>,
    states: Vec<f32>,
    starts: Vec<bool>,
}

impl Minibatch {
    /// Copies sequences of the memory: pairs of an agent and the number of its sequence. `columns`: those of the states to copy.
    fn gather(&mut self, memory: &Memory, sequences: &[(usize, usize)], columns: Range<usize>) {
        self.length = memory.length;
        self.obs.clear();
        self.masks.clear();
        self.samples.clear();
        self.states.clear();
        self.starts.clear();
        for step in 0..self.length {
            for &(agent, sequence) in sequences {
                let slot = sequence * self.length + step;
                self.obs.extend_from_slice(memory.obs(agent, slot));
                self.masks.extend_from_slice(memory.mask(agent, slot));
                let sample = *memory.sample(agent, slot);
                self.samples.push(sample);
                // A sequence begins in the state that it was recorded with, whether that was cleared or not.
                self.starts.push(step > 0 && sample.start);
            }
        }
        let states = sequences.iter().map(|&(agent, sequence)| memory.state(agent, sequence));
        states.for_each(|state| self.states.extend_from_slice(&state[columns.clone()]));
    }

    /// Brings values and returns to the unit of the critic, and counts advantages in a spread: their own, unless one is given.
    fn bring_to(&mut self, unit: Unit, spread: Option<Spread>) {
        let own = || Spread::of(self.samples.iter().map(|sample| sample.advantage));
        let spread = spread.unwrap_or_else(own);
        for sample in &mut self.samples {
            // The clip is about how far the network moves, and not the unit.
            (sample.value, sample.ret) = (sample.output, unit.output_of(sample.ret));
            sample.advantage = spread.normalise(sample.advantage);
        }
    }

    fn sequences(&self) -> Sequences<'_> {
        Sequences { steps: self.length, states: &self.states, starts: &self.starts }
    }
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;
    use crate::config::PolicyConfig;
    use crate::fixtures::region;
    use dials_core::base::{AgentId, Seed};
    use dials_core::domain::SourceSpec;
    use stacknets::Threads;

    /// Returns a stack of three agents and a memory of 16 random samples for each.
    fn material(recurrent: Option<usize>, separate_critic: bool) -> (PolicyStack, Memory) {
        let spec = region(4, 1, SourceSpec::bits(1), 8);
        let policy = PolicyConfig { recurrent, hidden: vec![6], separate_critic, ..PolicyConfig::default() };
        let stack = PolicyStack::new(&AgentId::all(3), &spec, &policy, &[0.0; 2], Seed::new(1));
        let length = if recurrent.is_some() { 4 } else { 1 };
        let mut memory = Memory::new(3, 16, length, &spec, stack.state_width());
        let mut dice = Seed::new(2).dice();
        for (agent, slot) in (0..3).flat_map(|agent| (0..16).map(move |slot| (agent, slot))) {
            let mut numbers = |count| (0..count).map(|_| dice.random_range(-1.0..1.0)).collect::<Vec<f32>>();
            let (obs, state, rest) = (numbers(4), numbers(stack.state_width()), numbers(2));
            let (advantage, ret) = (rest[0], 5.0 + rest[1]);
            let sample = Sample { action: slot as u8 % 2, log_prob: 0.5_f32.ln(), advantage, ret, ..Sample::default() };
            memory.remember(agent, slot, (&obs, &[]), &state, sample);
        }
        (stack, memory)
    }

    /// Updates all agents. `limit`: of the length of a gradient.
    fn updated(stack: &mut PolicyStack, adam: &mut Adam, memory: &Memory, learns: Learns, limit: Option<f64>) -> f64 {
        let ppo = PpoConfig { memory: 16, minibatch: 8, max_gradient_norm: limit, ..PpoConfig::default() };
        let decayed = Decayed { learning_rate: 1e-2, clip: 0.1 };
        let mut dice: Vec<Dice> = (0..3).map(|agent| Seed::new(3).for_agent(AgentId(agent)).dice()).collect();
        let units = ValueUnits::new(ppo.value_unit, 3);
        let settings = Settings { ppo: &ppo, units: &units, decayed, learns, shared: false };
        update(stack, adam, memory, &mut dice, settings, &mut Stopwatch::default())[0].value
    }

    #[test]
    fn while_the_critic_learns_alone_no_bit_of_the_actor_moves() {
        for (recurrent, separate) in [(None, false), (None, true), (Some(3), false), (Some(3), true)] {
            let (mut stack, memory) = material(recurrent, separate);
            let before = stack.parameters().values().clone();
            let mut adam = Adam::new(stack.parameters());
            let losses = [0, 1].map(|_| updated(&mut stack, &mut adam, &memory, Learns::Critic, None));
            assert!(losses[1] < losses[0], "{losses:?}");
            let critic = stack.only_critic();
            for agent in 0..3 {
                let rows = before.row(agent).iter().zip(stack.parameters().values().row(agent));
                let moved: Vec<bool> = rows.map(|(before, after)| before.to_bits() != after.to_bits()).collect();
                assert!(moved.iter().zip(&critic).all(|(moved, critic)| *critic || !moved), "{recurrent:?} {separate}");
                assert!(moved.iter().any(|&moved| moved));
                let moments = adam.moments();
                for (index, _) in critic.iter().enumerate().filter(|(_, critic)| !**critic) {
                    assert_eq!((moments.first.row(agent)[index], moments.second.row(agent)[index]), (0.0, 0.0));
                }
            }
        }
    }

    #[test]
    fn towers_of_a_shared_policy_in_two_threads_learn_the_same_bits() {
        for (recurrent, learns) in [(None, Learns::Everything), (Some(3), Learns::Everything), (None, Learns::Critic)] {
            let after = |threads: usize, limit: Option<f64>| {
                let (mut stack, memory) = material(recurrent, true);
                stack.net.use_threads(Threads::new(threads).unwrap());
                let mut adam = Adam::new(stack.parameters());
                let ppo = PpoConfig { memory: 16, minibatch: 8, max_gradient_norm: limit, ..PpoConfig::default() };
                let decayed = Decayed { learning_rate: 1e-2, clip: 0.1 };
                let (units, mut dice) = (ValueUnits::new(ppo.value_unit, 3), [Seed::new(3).dice()]);
                let settings = Settings { ppo: &ppo, units: &units, decayed, learns, shared: true };
                let mut watch = Stopwatch::default();
                let losses = update(&mut stack, &mut adam, &memory, &mut dice, settings, &mut watch);
                (losses, stack.parameters().values().clone(), adam, dice[0].random::<u64>())
            };
            let one = after(1, None);
            assert!(one.0[0].entropy > 0.1 && one.0[0].value > 0.1, "{:?}", one.0);
            assert_eq!(one, after(2, None), "{recurrent:?} {learns:?}");
            // A limit is for both: they stay together.
            assert_eq!(after(1, Some(1e-3)), after(2, Some(1e-3)));
        }
    }

    #[test]
    fn a_limit_on_the_gradient_counts_only_where_it_is_exceeded() {
        let after = |limit: Option<f64>| {
            let (mut stack, memory) = material(None, false);
            let mut adam = Adam::new(stack.parameters());
            updated(&mut stack, &mut adam, &memory, Learns::Everything, limit);
            (stack.parameters().values().clone(), adam.moments().first.row(0).to_vec())
        };
        let (without, high, low) = (after(None), after(Some(1e6)), after(Some(1e-3)));
        assert_eq!(without, high);
        assert!((0..3).all(|agent| without.0.row(agent) != low.0.row(agent)));
        // After six steps Adam's first moment holds the share 1 - 0.9^6 of such a mean of gradients.
        let length = |moments: &[f32]| moments.iter().map(|slope| slope * slope).sum::<f32>().sqrt();
        let share = 1.0 - 0.9_f32.powi(6);
        assert!((0.1e-3..share * 1.001e-3).contains(&length(&low.1)), "{}", length(&low.1));
        assert!(length(&without.1) > 0.1, "{}", length(&without.1));
    }
}
