//! Proximal policy optimisation: the clipped loss and its gradient, and the update of all agents from a memory.
//!
//! Source: Schulman et al. 2017, eq. 7 and 9; constants: DIALS paper, appendix "Hyperparameters". The details follow
//! the authors' code:
//!
//! - the loss of a minibatch is `-surrogate + c1 * value loss - beta * entropy`, each a mean over the minibatch;
//! - surrogate: `min(r A, clamp(r, 1 - eps, 1 + eps) A)`, `r = pi(a|o) / pi_old(a|o)`;
//! - value loss: `max((v - R)^2, (v_old + clamp(v - v_old, -eps, eps) - R)^2)`, without a factor 1/2;
//! - advantages are normalised per agent and minibatch, with the unbiased standard deviation and 1e-8;
//! - learning rate and clip decay linearly, to 1e-10 and 1e-5, over the total steps; gradients are not clipped.
//!
//! Losses are means within an agent and sums over agents, so every agent learns as if alone.

use std::ops::Range;
use std::time::Instant;

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use crate::base::{Dice, Phase, Stopwatch};
use crate::config::PpoConfig;
use crate::nn::{Adam, Learner, Sequences, Trace};
use crate::policy::{Memory, PolicyStack, Sample, sampling};

/// The two settings that decay over a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decayed {
    pub learning_rate: f64,
    pub clip: f64,
}

impl Decayed {
    /// Returns their values after the share `done` of the total steps.
    pub fn at(config: &PpoConfig, done: f64) -> Self {
        let decay = |from: f64, to: f64| from + (to - from) * done.clamp(0.0, 1.0);
        Decayed { learning_rate: decay(config.learning_rate, 1e-10), clip: decay(config.clip, 1e-5) }
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

/// Settings of an update.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    pub ppo: &'a PpoConfig,
    pub decayed: Decayed,
    pub learns: Learns,
    /// Whether all agents of the stack have one policy, see [`update`].
    pub shared: bool,
}

/// Weights of the loss.
#[derive(Clone, Copy, Debug)]
struct Weights {
    clip: f32,
    /// Clip range of the value.
    value_clip: f32,
    value: f32,
    entropy: f32,
}

/// Means over the samples of an agent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Losses {
    pub surrogate: f64,
    pub value: f64,
    pub entropy: f64,
    /// Mean of `ln pi_old - ln pi`, an estimate of the KL divergence.
    pub kl: f64,
    /// Share of the samples whose ratio left the clip range.
    pub clipped: f64,
}

impl Losses {
    /// Adds `weight` times other means.
    pub fn add(&mut self, other: &Losses, weight: f64) {
        self.surrogate += weight * other.surrogate;
        self.value += weight * other.value;
        self.entropy += weight * other.entropy;
        self.kl += weight * other.kl;
        self.clipped += weight * other.clipped;
    }
}

/// Updates all policies of the stack from the memory. Returns the mean losses of each agent over the update.
///
/// `dice`: one per agent, for its minibatches. Every agent makes all of its gradient steps before the next agent
/// begins. If the policies are shared, the first agent learns from the samples of all agents, in minibatches of the
/// same size, and the others copy its policy and its optimiser.
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
    let steps = settings.ppo.epochs * taught * (memory.capacity() / settings.ppo.minibatch);
    let only = (settings.learns == Learns::Critic).then(|| policies.only_critic());
    let threads = policies.threads().clone();
    let learners = policies.learners(adam, steps as u32);
    let agents = learners.into_iter().zip(dice).enumerate().take(learning).collect();
    let begun = Instant::now();
    let done = threads.map(agents, 2, |room: &mut UpdateBuffers, (agent, (learner, dice))| {
        room.learn(learner, memory, agent..agent + taught, dice, settings, only.as_deref())
    });
    let mut phases = Stopwatch::default();
    done.iter().for_each(|(_, of_agent)| phases.add(of_agent));
    watch.add(&phases.scaled_to(begun.elapsed()));
    if settings.shared {
        policies.spread_first();
        adam.spread_first();
    }
    done.into_iter().flat_map(|(losses, _)| vec![losses; taught]).collect()
}

/// Working memory of an update, used by one agent after another.
#[derive(Default)]
struct UpdateBuffers {
    minibatch: Minibatch,
    trace: Trace,
    /// Gradient of the loss by the outputs of the network.
    gradient: Vec<f32>,
}

impl UpdateBuffers {
    /// Makes all gradient steps of one learner, from the memories of `agents`. Returns the mean losses.
    ///
    /// `only`: which parameters change; `None` for all.
    fn learn(
        &mut self,
        mut learner: Learner<'_>,
        memory: &Memory,
        agents: Range<usize>,
        dice: &mut Dice,
        settings: Settings<'_>,
        only: Option<&[bool]>,
    ) -> (Losses, Stopwatch) {
        let Settings { ppo, decayed, .. } = settings;
        let clip = decayed.clip as f32;
        let weights = Weights {
            clip,
            value_clip: if only.is_some() { f32::INFINITY } else { clip },
            value: ppo.value_coefficient as f32,
            entropy: ppo.entropy as f32,
        };
        let UpdateBuffers { minibatch, trace, gradient } = self;
        let (mut losses, mut watch) = (Losses::default(), Stopwatch::default());
        let gradient_steps = ppo.epochs * agents.len() * (memory.capacity() / ppo.minibatch);
        let mut order: Vec<(usize, usize)> =
            agents.flat_map(|agent| (0..memory.sequences()).map(move |sequence| (agent, sequence))).collect();
        for _ in 0..ppo.epochs {
            order.shuffle(dice);
            for sequences in order.chunks_exact(ppo.minibatch / memory.length()) {
                watch.time(Phase::Bookkeeping, || minibatch.gather(memory, sequences));
                watch.time(Phase::Forward, || {
                    learner.network().forward(&minibatch.obs, minibatch.sequences(), trace);
                    gradient.resize(trace.output().len(), 0.0);
                    let of_batch =
                        loss_and_gradient(trace.output(), &minibatch.masks, &minibatch.samples, weights, gradient);
                    losses.add(&of_batch, 1.0 / gradient_steps as f64);
                });
                watch.time(Phase::Backward, || learner.network().backward(gradient, trace));
                if let Some(only) = only {
                    // Without a gradient Adam leaves a parameter as it is.
                    let frozen = trace.gradient_mut().iter_mut().zip(only).filter(|(_, learns)| !**learns);
                    frozen.for_each(|(slope, _)| *slope = 0.0);
                }
                watch.time(Phase::Adam, || learner.descend(trace.gradient(), decayed.learning_rate));
            }
        }
        (losses, watch)
    }
}

/// Some sequences of the memory; rows are ordered by step, then by sequence.
#[derive(Default)]
struct Minibatch {
    /// Number of steps of each sequence.
    length: usize,
    obs: Vec<f32>,
    /// `[rows, n_actions]`; empty if the kind has no masks.
    masks: Vec<bool>,
    samples: Vec<Sample>,
    states: Vec<f32>,
    starts: Vec<bool>,
}

impl Minibatch {
    /// Copies sequences of the memory: pairs of an agent and the number of its sequence.
    fn gather(&mut self, memory: &Memory, sequences: &[(usize, usize)]) {
        self.length = memory.length();
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
        states.for_each(|state| self.states.extend_from_slice(state));
    }

    fn sequences(&self) -> Sequences<'_> {
        Sequences { steps: self.length, states: &self.states, starts: &self.starts }
    }
}

/// Returns the loss of one agent's minibatch, and writes its gradient with respect to the network's outputs.
///
/// `outputs`, `gradient`: `[batch, n_actions + 1]`, logits and value; `masks`: `[batch, n_actions]`, or empty if all
/// actions are allowed.
fn loss_and_gradient(
    outputs: &[f32],
    masks: &[bool],
    samples: &[Sample],
    weights: Weights,
    gradient: &mut [f32],
) -> Losses {
    let width = outputs.len() / samples.len();
    let n_actions = width - 1;
    let batch = samples.len() as f32;
    let (mut logits, mut log_probs) = (vec![0.0; n_actions], vec![0.0; n_actions]);
    let mut masks = masks.chunks_exact(n_actions);
    let mut losses = Losses::default();
    let advantages = normalised(samples);
    let rows = outputs.chunks_exact(width).zip(gradient.chunks_exact_mut(width));
    for (((output, gradient), sample), advantage) in rows.zip(samples).zip(advantages) {
        match masks.next() {
            Some(mask) => {
                logits.copy_from_slice(&output[..n_actions]);
                sampling::forbid(&mut logits, mask);
                sampling::log_softmax(&logits, &mut log_probs);
            }
            None => sampling::log_softmax(&output[..n_actions], &mut log_probs),
        }
        let action = usize::from(sample.action);
        let entropy = sampling::entropy(&log_probs);

        let ratio = (log_probs[action] - sample.log_prob).exp();
        let clipped = ratio.clamp(1.0 - weights.clip, 1.0 + weights.clip);
        let surrogate = (ratio * advantage).min(clipped * advantage);
        // If the clipped term is the smaller one, the surrogate does not depend on the policy.
        let policy_slope = if ratio * advantage <= clipped * advantage { ratio * advantage } else { 0.0 };
        for (logit, (gradient, log_prob)) in gradient[..n_actions].iter_mut().zip(&log_probs).enumerate() {
            let prob = log_prob.exp();
            let chosen = if logit == action { 1.0 } else { 0.0 };
            // d ln pi(a) / d logit_k = [k = a] - p_k;  d H / d logit_k = -p_k (ln p_k + H)
            let surrogate_slope = policy_slope * (chosen - prob);
            let entropy_slope = -prob * (log_prob + entropy);
            // A forbidden action has probability 0, whatever its logit, so all derivatives by that logit are 0.
            let forbidden = *log_prob == f32::NEG_INFINITY;
            *gradient = if forbidden { 0.0 } else { -(surrogate_slope + weights.entropy * entropy_slope) / batch };
        }

        let value = output[n_actions];
        let moved = value - sample.value;
        let near = sample.value + moved.clamp(-weights.value_clip, weights.value_clip);
        let (error, near_error) = (value - sample.ret, near - sample.ret);
        let value_loss = (error * error).max(near_error * near_error);
        // The clipped term depends on the value only inside the clip range. There both terms are equal except for
        // rounding. `v_old + (v - v_old)` may miss `v` by a digit, which must not decide.
        let inside = moved.abs() <= weights.value_clip;
        let value_slope = if inside || error * error >= near_error * near_error { 2.0 * error } else { 0.0 };
        gradient[n_actions] = weights.value * value_slope / batch;

        let of_sample = Losses {
            surrogate: f64::from(surrogate),
            value: f64::from(value_loss),
            entropy: f64::from(entropy),
            kl: f64::from(sample.log_prob - log_probs[action]),
            clipped: f64::from(u8::from(ratio != clipped)),
        };
        losses.add(&of_sample, 1.0 / f64::from(batch));
    }
    losses
}

/// Returns the advantages with mean 0 and (unbiased) standard deviation 1.
fn normalised(samples: &[Sample]) -> impl Iterator<Item = f32> {
    let count = samples.len() as f32;
    let mean = samples.iter().map(|sample| sample.advantage).sum::<f32>() / count;
    let variance = samples.iter().map(|sample| (sample.advantage - mean).powi(2)).sum::<f32>() / (count - 1.0);
    let deviation = variance.sqrt() + 1e-8;
    samples.iter().map(move |sample| (sample.advantage - mean) / deviation)
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;
    use crate::base::{AgentId, Seed};
    use crate::config::PolicyConfig;
    use crate::domain::{RegionSpec, SourceSpec};

    const WEIGHTS: Weights = Weights { clip: 0.1, value_clip: 0.1, value: 1.0, entropy: 0.0 };

    fn sample(action: u8, old_prob: f32, value: f32, advantage: f32, ret: f32) -> Sample {
        Sample { action, log_prob: old_prob.ln(), value, advantage, ret, start: false }
    }

    fn close(a: &[f32], b: &[f32]) -> bool {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-5)
    }

    #[test]
    fn the_loss_of_two_samples_is_worked_out_by_hand() {
        // Advantages 1 and -1 normalise to +-1 / sqrt(2) = +-0.70711 (unbiased deviation sqrt(2)).
        // Sample 1: logits (0, ln 3), action 1: p = 0.75, old 0.7: r = 1.07143, inside 1 +- 0.1.
        //   surrogate 1.07143 * 0.70711 = 0.75761; slope: 0.75761 * ([k = a] - p_k) = (-0.18940, 0.18940)
        // Sample 2: logits (0, 0), action 0: p = 0.5, old 0.4: r = 1.25, clipped 1.1; A < 0:
        //   min(-0.88388, -0.77782) = -0.88388, the unclipped term: slope -0.88388 * (0.5, -0.5) = (-0.44194, 0.44194)
        // Values: sample 1: v = 2, v_old = 2.05, R = 3: (2 - 3)^2 = 1, near = 2: 1; slope 2 * -1 = -2
        //         sample 2: v = 1, v_old = 0.5, R = 1.2: (1 - 1.2)^2 = 0.04, near = 0.6: 0.36 is larger: slope 0
        let samples = [sample(1, 0.7, 2.05, 1.0, 3.0), sample(0, 0.4, 0.5, -1.0, 1.2)];
        let outputs = [0.0, 3_f32.ln(), 2.0, 0.0, 0.0, 1.0];
        let mut gradient = [0.0; 6];
        let losses = loss_and_gradient(&outputs, &[], &samples, WEIGHTS, &mut gradient);
        assert!((losses.surrogate - (0.757_61 - 0.883_88) / 2.0).abs() < 1e-5, "{losses:?}");
        assert!((losses.value - (1.0 + 0.36) / 2.0).abs() < 1e-5, "{losses:?}");
        assert!((losses.clipped - 0.5).abs() < 1e-12);
        assert!(close(&gradient, &[0.094_70, -0.094_70, -1.0, 0.220_97, -0.220_97, 0.0]), "{gradient:?}");
    }

    #[test]
    fn a_value_inside_the_clip_range_is_pulled_however_its_sums_round() {
        // v_old = v + 0.05 (inside the range of 0.1), R = 0: slope 2 (v - 0) / 2 samples = v.
        let mut misses = 0;
        for value in (1..1000).map(|i| i as f32 * 3.7e-5) {
            let old = value + 0.05;
            misses += u32::from((old + (value - old)).powi(2) > value.powi(2));
            let mut gradient = [0.0; 6];
            let samples = [sample(0, 0.5, old, 1.0, 0.0); 2];
            loss_and_gradient(&[0.0, 0.0, value, 0.0, 0.0, value], &[], &samples, WEIGHTS, &mut gradient);
            assert_eq!(gradient[2], value);
        }
        assert!(misses > 0, "some sums round the wrong way, or this test shows nothing");
    }

    #[test]
    fn a_ratio_that_left_the_clip_range_the_good_way_pulls_no_further() {
        // Sample 1: p = 0.5, old 0.25: r = 2 > 1.1 with A > 0; sample 2: r = 0.5 < 0.9 with A < 0: both are clipped.
        let samples = [sample(0, 0.25, 0.0, 1.0, 0.0), sample(0, 1.0, 0.0, -1.0, 0.0)];
        let mut gradient = [9.0; 6];
        let losses = loss_and_gradient(&[0.0; 6], &[], &samples, WEIGHTS, &mut gradient);
        assert!(close(&gradient, &[0.0; 6]), "{gradient:?}");
        // (1.1 * 0.70711 - 0.9 * 0.70711) / 2
        assert!((losses.surrogate - 0.070_711).abs() < 1e-5);
    }

    #[test]
    fn the_entropy_bonus_pulls_towards_equal_probabilities() {
        // p = (0.25, 0.75), H = 0.56234: dH/dlogit = -p (ln p + H) = (0.20599, -0.20599); beta 0.1, batch 2.
        let weights = Weights { entropy: 0.1, ..WEIGHTS };
        let samples = [sample(0, 0.25, 0.0, 0.0, 0.0); 2];
        let outputs = [0.0, 3_f32.ln(), 0.0, 0.0, 3_f32.ln(), 0.0];
        let mut gradient = [0.0; 6];
        let losses = loss_and_gradient(&outputs, &[], &samples, weights, &mut gradient);
        assert!((losses.entropy - 0.562_335).abs() < 1e-5);
        assert!(close(&gradient, &[-0.010_299, 0.010_299, 0.0, -0.010_299, 0.010_299, 0.0]), "{gradient:?}");
    }

    #[test]
    fn the_gradient_agrees_with_finite_differences() {
        let weights = Weights { clip: 0.2, value_clip: 0.2, value: 0.7, entropy: 0.05 };
        let samples = [
            sample(2, 0.30, 0.4, 1.3, 0.9),
            sample(0, 0.28, -0.1, -0.4, 0.1),
            sample(1, 0.45, 0.1, 0.2, -0.6),
            sample(1, 0.20, 1.0, -2.0, 1.4),
        ];
        let outputs: Vec<f32> = (0..16).map(|i| ((i * 7 % 11) as f32 - 5.0) / 12.0).collect();
        let loss = |outputs: &[f32]| {
            let losses = loss_and_gradient(outputs, &[], &samples, weights, &mut [0.0; 16]);
            -losses.surrogate + 0.7 * losses.value - 0.05 * losses.entropy
        };
        let mut gradient = [0.0; 16];
        loss_and_gradient(&outputs, &[], &samples, weights, &mut gradient);
        for i in 0..16 {
            let shifted = |by: f32| {
                let mut outputs = outputs.clone();
                outputs[i] += by;
                loss(&outputs)
            };
            let slope = (shifted(1e-3) - shifted(-1e-3)) / 2e-3;
            assert!((slope - f64::from(gradient[i])).abs() < 1e-3, "output {i}: {slope} {}", gradient[i]);
        }
    }

    #[test]
    fn an_action_that_is_masked_is_as_if_it_did_not_exist() {
        // The same two actions, once alone and once with a third between them that is masked, whatever its logit.
        let weights = Weights { clip: 0.2, value_clip: 0.2, value: 0.7, entropy: 0.05 };
        let alone = [sample(0, 0.3, 0.4, 1.3, 0.9), sample(1, 0.28, -0.1, -0.4, 0.1)];
        let masked = [alone[0], Sample { action: 2, ..alone[1] }];
        let (mut two, mut three) = ([0.0; 6], [9.0; 8]);
        let of_two = loss_and_gradient(&[0.1, -0.2, 0.5, 0.3, 0.2, -0.1], &[], &alone, weights, &mut two);
        let outputs = [0.1, 7.0, -0.2, 0.5, 0.3, -3.0, 0.2, -0.1];
        let masks = [true, false, true, true, false, true];
        let of_three = loss_and_gradient(&outputs, &masks, &masked, weights, &mut three);
        assert_eq!(of_two, of_three);
        assert_eq!([three[1], three[5]], [0.0; 2], "it is not moved");
        assert_eq!([three[0], three[2], three[3], three[4], three[6], three[7]], two);
    }

    #[test]
    fn learning_rate_and_clip_decay_over_the_total_steps() {
        let config = PpoConfig::default();
        assert_eq!(Decayed::at(&config, 0.0), Decayed { learning_rate: 2.5e-4, clip: 0.1 });
        let half = Decayed::at(&config, 0.5);
        assert!((half.learning_rate - 1.250_000_5e-4).abs() < 1e-12 && (half.clip - 0.050_005).abs() < 1e-12);
        let end = Decayed::at(&config, 1.0);
        assert!((end.learning_rate - 1e-10).abs() < 1e-18 && (end.clip - 1e-5).abs() < 1e-12);
    }

    /// Returns a stack of three agents and a memory of 16 random samples for each.
    fn material(recurrent: Option<usize>, separate_critic: bool) -> (PolicyStack, Memory) {
        let sources = SourceSpec::bits(1);
        let spec =
            RegionSpec { obs_dim: 4, d_set_dim: 1, n_actions: 2, masks: false, sources, horizon: 8, local_horizon: 8 };
        let policy = PolicyConfig { recurrent, hidden: vec![6], separate_critic, ..PolicyConfig::default() };
        let stack = PolicyStack::new(&AgentId::all(3), &spec, &policy, &[0.0; 2], Seed::new(1));
        let length = if recurrent.is_some() { 4 } else { 1 };
        let mut memory = Memory::new(3, 16, length, &spec, stack.state_width());
        let mut dice = Seed::new(2).dice();
        for (agent, slot) in (0..3).flat_map(|agent| (0..16).map(move |slot| (agent, slot))) {
            let mut numbers = |count| (0..count).map(|_| dice.random_range(-1.0..1.0)).collect::<Vec<f32>>();
            let (obs, state, rest) = (numbers(4), numbers(stack.state_width()), numbers(2));
            let sample =
                Sample { advantage: rest[0], ret: 5.0 + rest[1], ..sample(slot as u8 % 2, 0.5, 0.0, 0.0, 0.0) };
            memory.remember(agent, slot, &obs, &state, sample);
        }
        (stack, memory)
    }

    fn updated(stack: &mut PolicyStack, adam: &mut Adam, memory: &Memory, learns: Learns, shared: bool) -> Vec<Losses> {
        let ppo = PpoConfig { memory: 16, minibatch: 8, ..PpoConfig::default() };
        let decayed = Decayed { learning_rate: 1e-2, clip: 0.1 };
        let mut dice: Vec<Dice> = (0..3).map(|agent| Seed::new(3).for_agent(AgentId(agent)).dice()).collect();
        let settings = Settings { ppo: &ppo, decayed, learns, shared };
        update(stack, adam, memory, &mut dice, settings, &mut Stopwatch::default())
    }

    #[test]
    fn while_the_critic_learns_alone_no_bit_of_the_actor_moves() {
        for (recurrent, separate) in [(None, false), (None, true), (Some(3), false), (Some(3), true)] {
            let (mut stack, memory) = material(recurrent, separate);
            let before = stack.parameters().values().clone();
            let mut adam = Adam::new(stack.parameters());
            let losses = [0, 1].map(|_| updated(&mut stack, &mut adam, &memory, Learns::Critic, false)[0].value);
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
    fn a_critic_alone_is_not_held_back_by_the_clip() {
        // v = 0.5, v_old = 0, R = 5: with a clip of 0.1 the value has already moved too far; 2 (0.5 - 5) / 2 = -4.5.
        let samples = [sample(0, 0.5, 0.0, 1.0, 5.0); 2];
        let outputs = [0.0, 0.0, 0.5, 0.0, 0.0, 0.5];
        let mut gradient = [9.0; 6];
        loss_and_gradient(&outputs, &[], &samples, WEIGHTS, &mut gradient);
        assert_eq!(gradient[2], 0.0);
        let alone = Weights { value_clip: f32::INFINITY, ..WEIGHTS };
        loss_and_gradient(&outputs, &[], &samples, alone, &mut gradient);
        assert_eq!(gradient[2], -4.5);
    }

    #[test]
    fn agents_with_one_policy_keep_it_and_learn_from_the_samples_of_all() {
        let (mut stack, mut memory) = material(Some(3), false);
        stack.spread_first();
        let mut adam = Adam::new(stack.parameters());
        let before = stack.parameters().values().row(0).to_vec();
        let losses = updated(&mut stack, &mut adam, &memory, Learns::Everything, true);
        assert_eq!(losses, vec![losses[0]; 3]);
        // 3 epochs of 3 agents with 2 minibatches each.
        assert_eq!(adam.moments().steps, 18);
        let rows = stack.parameters().values().clone();
        assert!((1..3).all(|agent| rows.row(agent) == rows.row(0)) && rows.row(0) != before);
        let moments = adam.moments();
        assert!([&moments.first, &moments.second].iter().all(|rows| rows.row(2) == rows.row(0)));
        // A sample of the last agent changes the policy of all.
        let (mut other, _) = material(Some(3), false);
        other.spread_first();
        memory.sample_mut(2, 15).ret += 1.0;
        updated(&mut other, &mut Adam::new(stack.parameters()), &memory, Learns::Everything, true);
        assert_ne!(other.parameters().values().row(0), rows.row(0));
    }
}
