//! Imitation of a hand-coded controller before PPO: episodes in which it decides, and behaviour cloning on them.
//!
//! Every agent's policy learns the controller's actions from the agent's own observations, by gradient descent on the
//! cross-entropy. The value is left alone: PPO trains it first, see `critic_steps`.

use std::ops::Range;

use rand::Rng;
use rand::seq::{IteratorRandom, SliceRandom};
use serde::{Deserialize, Serialize};

use crate::config::{Config, ImitationConfig, held_out_episodes};
use crate::policy::{Demonstrations, PolicyStack};
use dials_core::base::{AgentId, Dice, Phase, RandomPurpose, Seed, Stopwatch, Work};
use dials_core::domain::sampling;
use dials_core::domain::{Action, Controller, GlobalSimulator, Result};
use stacknets::{Adam, Network, Sequences, Trace};

/// Number of samples on which policies are measured at once.
const CHUNK: usize = 512;

/// How well one agent's policy imitates on the held-out episodes, before and after the imitation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImitationLoss {
    /// Mean cross-entropy of the controller's actions, in nats.
    pub cross_entropy: [f64; 2],
    /// Share of the decisions in which the controller's action is the most probable one.
    pub accuracy: [f64; 2],
}

impl ImitationLoss {
    pub fn mean_of(losses: &[ImitationLoss]) -> ImitationLoss {
        let mean = |pick: &dyn Fn(&ImitationLoss) -> f64| losses.iter().map(pick).sum::<f64>() / losses.len() as f64;
        ImitationLoss {
            cross_entropy: [0, 1].map(|when| mean(&|loss| loss.cross_entropy[when])),
            accuracy: [0, 1].map(|when| mean(&|loss| loss.accuracy[when])),
        }
    }
}

/// Plays one episode and appends what every agent saw, and what the controller decided, to its demonstrations.
///
/// In a share of the decisions, `slips`, a random action is carried out instead. A copy that has only seen what the
/// controller itself gets into does not know how to come back from its own small errors. (Laskey et al. 2017, "DART".)
/// Control inside the simulator that cannot be asked before the step, such as SUMO's own, never slips.
pub fn demonstrate(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    episode: Seed,
    slips: f64,
    demonstrations: &mut [Demonstrations],
) -> Result<()> {
    let n_actions: Vec<usize> = simulator.kinds().specs().map(|spec| spec.n_actions).collect();
    let mut dice = episode.fork(RandomPurpose::Slips).dice();
    let mut decided: Vec<Action> = vec![0; simulator.agents()];
    let mut done: Vec<Option<Action>> = vec![None; simulator.agents()];
    controller.begin(episode);
    let mut percept = simulator.reset(episode)?.clone();
    for _ in 0..simulator.kinds().horizon() {
        controller.act(&percept, &mut decided)?;
        let is_known = simulator.advise(&mut decided) || controller.decides();
        let mut actions = decided.clone();
        if is_known {
            for ((action, &n_actions), mask) in actions.iter_mut().zip(&n_actions).zip(percept.masks.iter()) {
                if dice.random_bool(slips) {
                    let allowed = |action: &usize| mask.get(*action) != Some(&false);
                    let slip = (0..n_actions).filter(allowed).choose(&mut dice);
                    *action = slip.expect("some action is allowed") as Action;
                }
            }
        }
        let after = simulator.step(&actions)?.percept.clone();
        done.iter_mut().zip(&actions).for_each(|(done, &action)| *done = Some(action));
        simulator.carried_out(&mut done);
        for (agent, demonstrations) in demonstrations.iter_mut().enumerate() {
            let mask = percept.masks.row(agent);
            let action = if is_known { done[agent].and(Some(decided[agent])) } else { done[agent] };
            // A policy cannot take an action that is not allowed, so there it cannot learn it either.
            let action = action.filter(|&action| mask.get(usize::from(action)) != Some(&false));
            demonstrations.push(percept.obs.row(agent), mask, action);
        }
        percept = after;
    }
    Ok(())
}

/// Makes every policy imitate its agent's demonstrations, and measures it before and after. If the policies are shared, they
/// imitate those of all agents.
///
/// `demonstrations`: one per agent of the stack, all of the same length. The last `held_out` of the episodes only
/// measure. The optimiser starts from zero, and the incomplete last minibatch of an epoch is dropped. Policies with
/// memory learn from whole episodes, others from single samples. `progress` is called with the share that is done.
pub(crate) fn imitate(
    policies: &mut PolicyStack,
    agents: &[AgentId],
    demonstrations: &[Demonstrations],
    config: &Config,
    work: Work<'_, f64>,
) -> Vec<ImitationLoss> {
    let Work { watch, progress } = work;
    let seed = Seed::new(config.seed).fork(RandomPurpose::ImitationMinibatches);
    let ImitationConfig { epochs, minibatch, learning_rate, held_out, .. } = config.imitation;
    let (episodes, horizon) = (demonstrations[0].episodes(), demonstrations[0].horizon);
    let length = if policies.state_width() > 0 { horizon } else { 1 };
    let per_episode = horizon / length;
    let training = (episodes - held_out_episodes(episodes, held_out)) * per_episode;
    let held_out = training..episodes * per_episode;
    let (learning, taught) = if config.shares_policies() { (1, agents.len()) } else { (agents.len(), 1) };
    let batches = training * taught / minibatch;
    let mut room = Buffers { length, n_actions: policies.n_actions(), ..Buffers::default() };
    let before = room.measure(policies, demonstrations, &held_out, watch);
    let mut adam = Adam::new(policies.parameters());
    let learners = policies.learners(&mut adam, (epochs * batches) as u32);
    for (index, (mut learner, &agent)) in learners.into_iter().zip(agents).enumerate().take(learning) {
        let mut dice: Dice = seed.for_agent(agent).dice();
        let teachers = index..index + taught;
        let mut order: Vec<(usize, usize)> =
            teachers.flat_map(|teacher| (0..training).map(move |sequence| (teacher, sequence))).collect();
        for epoch in 0..epochs {
            order.shuffle(&mut dice);
            for (batch, sequences) in order.chunks_exact(minibatch).enumerate() {
                let of_epoch = batch as f64 / batches as f64;
                progress((index as f64 + (epoch as f64 + of_epoch) / epochs as f64) / learning as f64);
                watch.time(Phase::Bookkeeping, || room.gather(demonstrations, sequences.iter().copied()));
                watch.time(Phase::Forward, || {
                    room.forward(learner.network());
                    room.compare();
                });
                watch.time(Phase::Backward, || learner.network().backward(&room.gradient, &mut room.trace));
                watch.time(Phase::Adam, || learner.descend(room.trace.gradient(), learning_rate));
            }
        }
    }
    if config.shares_policies() {
        policies.net.spread_first();
    }
    let after = room.measure(policies, demonstrations, &held_out, watch);
    let losses = before.into_iter().zip(after).map(|(before, after)| ImitationLoss {
        cross_entropy: [before, after].map(Comparison::cross_entropy),
        accuracy: [before, after].map(Comparison::accuracy),
    });
    losses.collect()
}

#[derive(Clone, Copy, Default)]
struct Comparison {
    decisions: usize,
    cross_entropy: f64,
    hits: usize,
}

impl Comparison {
    fn add(&mut self, other: Comparison) {
        self.decisions += other.decisions;
        self.cross_entropy += other.cross_entropy;
        self.hits += other.hits;
    }

    fn cross_entropy(self) -> f64 {
        self.cross_entropy / self.decisions.max(1) as f64
    }

    fn accuracy(self) -> f64 {
        self.hits as f64 / self.decisions.max(1) as f64
    }
}

/// Working memory of an imitation, one agent after another: some sequences of its demonstrations, rows ordered by step,
/// then by sequence.
#[derive(Default)]
struct Buffers {
    length: usize,
    n_actions: usize,
    obs: Vec<f32>,
    /// `[rows, n_actions]`; empty if the kind has no masks.
    masks: Vec<bool>,
    actions: Vec<Option<Action>>,
    /// Cleared states: sequences begin with episodes, and no episode begins within.
    states: Vec<f32>,
    starts: Vec<bool>,
    trace: Trace,
    /// Gradient of the loss by the outputs of the network.
    gradient: Vec<f32>,
}

impl Buffers {
    /// Copies sequences: pairs of an agent and the number of its sequence.
    fn gather(&mut self, from: &[Demonstrations], sequences: impl ExactSizeIterator<Item = (usize, usize)> + Clone) {
        let width = from[0].obs.width();
        self.obs.resize(sequences.len() * self.length * width, 0.0);
        self.masks.clear();
        self.actions.clear();
        let mut rows = self.obs.chunks_exact_mut(width);
        for step in 0..self.length {
            for (agent, sequence) in sequences.clone() {
                let (from, sample) = (&from[agent], sequence * self.length + step);
                from.obs.read(sample, rows.next().expect("a place per row"));
                self.masks.extend_from_slice(from.mask(sample));
                self.actions.push(from.actions[sample]);
            }
        }
    }

    fn forward(&mut self, network: Network<'_>) {
        let rows = self.actions.len();
        self.states.resize(rows / self.length * network.state_width(), 0.0);
        self.starts.resize(rows, false);
        let sequences = Sequences { steps: self.length, states: &self.states, starts: &self.starts };
        network.forward(&self.obs, sequences, &mut self.trace);
    }

    /// Compares the outputs, `[rows, n_actions + 1]`, with the actions. Writes the gradient of the mean cross-entropy;
    /// it is 0 by the value, and where there is nothing to imitate.
    fn compare(&mut self) -> Comparison {
        let n_actions = self.n_actions;
        let outputs = self.trace.output();
        self.gradient.clear();
        self.gradient.resize(outputs.len(), 0.0);
        let decisions = self.actions.iter().flatten().count();
        let mut found = Comparison { decisions, ..Comparison::default() };
        let (mut logits, mut log_probs) = (vec![0.0; n_actions], vec![0.0; n_actions]);
        let rows = outputs.chunks_exact(n_actions + 1).zip(self.gradient.chunks_exact_mut(n_actions + 1));
        for (row, ((output, gradient), action)) in rows.zip(&self.actions).enumerate() {
            let Some(action) = action.map(usize::from) else { continue };
            logits.copy_from_slice(&output[..n_actions]);
            sampling::forbid(&mut logits, self.masks.chunks_exact(n_actions).nth(row).unwrap_or(&[]));
            sampling::log_softmax(&logits, &mut log_probs);
            found.cross_entropy -= f64::from(log_probs[action]);
            found.hits += usize::from(usize::from(sampling::most_probable(&log_probs)) == action);
            // d -ln pi(a) / d logit_k = p_k - [k = a]
            for (index, (slope, log_prob)) in gradient.iter_mut().zip(&log_probs).enumerate() {
                let chosen = if index == action { 1.0 } else { 0.0 };
                *slope = (log_prob.exp() - chosen) / decisions as f32;
            }
        }
        found
    }

    /// Compares every policy with some sequences of its agent's demonstrations.
    fn measure(
        &mut self,
        policies: &PolicyStack,
        demonstrations: &[Demonstrations],
        sequences: &Range<usize>,
        watch: &mut Stopwatch,
    ) -> Vec<Comparison> {
        let chunk = (CHUNK / self.length).max(1);
        let mut of_agent = |agent: usize| {
            let mut found = Comparison::default();
            for start in sequences.clone().step_by(chunk) {
                let some = (start..sequences.end.min(start + chunk)).map(|sequence| (agent, sequence));
                watch.time(Phase::Bookkeeping, || self.gather(demonstrations, some));
                watch.time(Phase::Forward, || {
                    self.forward(policies.net.network(agent));
                    found.add(self.compare());
                });
            }
            found
        };
        (0..demonstrations.len()).map(&mut of_agent).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{PolicyConfig, Share};
    use crate::fixtures::region;
    use dials_core::domain::{Baseline, Domain, SourceSpec};
    use dials_testkit::toy::{Coins, CoinsAndDice};

    /// Lets a controller play and one kind of agents imitate it.
    fn imitated(
        domain: &dyn Domain,
        controller: &str,
        kind: usize,
        policy: &PolicyConfig,
        config: &ImitationConfig,
    ) -> Vec<ImitationLoss> {
        let Baseline { mut simulator, mut controller } = domain.baseline(controller).unwrap();
        let mut all = Demonstrations::of_all(domain.kinds());
        for episode in 0..config.episodes(domain.kinds().horizon()) {
            let seed = Seed::new(2).for_episode(episode);
            demonstrate(&mut *simulator, &mut *controller, seed, config.slips, &mut all).unwrap();
        }
        let kind = &domain.kinds()[kind];
        let theirs: Vec<Demonstrations> = kind.agents.iter().map(|agent| all[agent.0].clone()).collect();
        let bias = vec![0.0; kind.spec.n_actions];
        let mut policies = PolicyStack::new(&kind.agents, &kind.spec, policy, &bias, Seed::new(3));
        let work = Work { watch: &mut Stopwatch::default(), progress: &mut |_| () };
        let config = Config { imitation: config.clone(), policy: policy.clone(), ..Config::default() };
        imitate(&mut policies, &kind.agents, &theirs, &config, work)
    }

    /// The controller of this domain decides outside of the simulator, which cannot be asked.
    #[test]
    fn whoever_decides_before_the_step_slips() {
        let with = |slips: f64| {
            let Baseline { mut simulator, mut controller } = Coins::new(50).baseline("copy").unwrap();
            let mut all = Demonstrations::of_all(simulator.kinds());
            demonstrate(&mut *simulator, &mut *controller, Seed::new(2), slips, &mut all).unwrap();
            all
        };
        assert!(with(0.0) == with(0.0) && with(0.0) != with(0.5));
    }

    #[test]
    fn coins_learn_to_copy_and_dice_the_best_of_their_allowed_moves_with_and_without_a_memory() {
        let (coins, dice) = (Coins::new(50), CoinsAndDice::new(50));
        for (domain, controller, kind, recurrent, separate_critic, share) in [
            (&coins as &dyn Domain, "copy", 0, None, true, Share::None),
            (&coins, "copy", 0, Some(8), false, Share::Kind),
            (&coins, "copy", 0, Some(8), true, Share::None),
            (&dice, "best", 1, None, false, Share::Kind),
        ] {
            let minibatch = if recurrent.is_some() { 4 } else { 32 };
            let config = ImitationConfig {
                dataset_steps: 2000,
                epochs: 8,
                minibatch,
                learning_rate: 1e-2,
                ..Default::default()
            };
            let policy =
                PolicyConfig { recurrent, hidden: vec![16], separate_critic, share, ..PolicyConfig::default() };
            for loss in imitated(domain, controller, kind, &policy, &config) {
                // A random network says the right one of two with about 1/2: ln 2 = 0.69. A die's third face is masked.
                assert!((loss.cross_entropy[0] - 0.69).abs() < 0.2, "{controller}: {loss:?}");
                assert!(
                    loss.accuracy[1] > 0.99 && loss.cross_entropy[1] < 0.05,
                    "{controller} {recurrent:?}: {loss:?}"
                );
            }
        }
    }

    #[test]
    fn cross_entropy_and_gradient_are_worked_out_by_hand_without_what_has_no_effect() {
        let spec = region(1, 1, SourceSpec::bits(1), 3);
        let mut demonstrations = Demonstrations::new(&spec);
        for action in [Some(0), None, Some(1)] {
            demonstrations.push(&[1.0], &[], action);
        }
        let policy = PolicyConfig { hidden: vec![1], ..PolicyConfig::default() };
        let mut stack = PolicyStack::blank(1, &spec, &policy);
        // The hidden unit is off; biases of the outputs: logits 0 and ln 3, so the probabilities are 1/4 and 3/4.
        let row = vec![0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 3_f32.ln(), 7.0];
        stack.load(&dials_core::base::Rows::from_vec(row, 8));
        let mut adam = Adam::new(stack.parameters());
        let learner = stack.learners(&mut adam, 0).remove(0);
        let mut room = Buffers { length: 1, n_actions: 2, ..Buffers::default() };
        room.gather(&[demonstrations], (0..3).map(|sequence| (0, sequence)));
        room.forward(learner.network());
        let found = room.compare();
        // (ln 4 + ln (4/3)) / 2 = 0.836988; one of two is the more probable one.
        assert!((found.cross_entropy() - 0.836_988).abs() < 1e-6);
        assert_eq!((found.decisions, found.accuracy()), (2, 0.5));
        let expected = [-0.375, 0.375, 0.0, 0.0, 0.0, 0.0, 0.125, -0.125, 0.0];
        let equal = room.gradient.iter().zip(expected).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-6);
        assert!(equal, "{:?}", room.gradient);
    }
}
