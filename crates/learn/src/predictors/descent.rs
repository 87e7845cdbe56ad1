//! How AIPs learn: gradient descent on the cross-entropy, one agent after another.

use std::ops::Range;
use std::time::Instant;

use rand::seq::SliceRandom;

use super::aip::{Constants, scaled};
use super::parts::part_of;
use super::{AipStack, CrossEntropies, Dataset, Lesson, sources};
use crate::config::AipConfig;
use crate::side_by_side::in_threads;
use dials_core::base::{Dice, Phase, Stopwatch, Work};
use dials_core::domain::SourceSpec;
use stacknets::{Adam, Network, Sequences, Trace, Trainer};

/// Number of samples for which losses are measured at once.
const LOSS_CHUNK: usize = 512;

/// Trains every agent's AIP on its own dataset.
///
/// Adam starts from zero and the incomplete last batch of an epoch is dropped, as in the authors' code. The weights
/// continue from the previous training. AIPs with memory are trained on whole episodes, others on single samples.
/// Minibatches are drawn from `dice`, one per agent. The held-out samples decide when to stop early, if the config says
/// so.
pub(super) fn descend(aips: &mut AipStack, lesson: Lesson<'_>, dice: &mut [Dice], work: Work<'_, f64>) {
    let Lesson { datasets, samples, config, threads } = lesson;
    let Work { watch, progress } = work;
    let steps = sequence_length(aips, datasets);
    let AipStack { sources: spec, net, constants, .. } = aips;
    let (spec, constants) = (&*spec, constants.as_ref());
    // Sequences of `steps` samples each.
    let batches = samples / steps / config.batch;
    let mut adam = Adam::new(net.parameters());
    let learners = adam.trainers(net, (config.epochs * batches) as u32);
    let agents: Vec<_> = learners.into_iter().zip(datasets).zip(dice).enumerate().collect();
    let (mut done, all) = (0, agents.len() * config.epochs);
    let epoch_done = &mut || {
        done += 1;
        progress(done as f64 / all as f64);
    };
    let begun = Instant::now();
    let learn = |room: &mut LearningBuffers, (index, ((learner, dataset), dice)), epoch_done: &mut dyn FnMut()| {
        let pupil = Pupil { learner, dataset, spec, constants: constants.map(|all| (all, index)), steps };
        pupil.learn(room, samples, config, dice, epoch_done)
    };
    let watches: Vec<Stopwatch> = in_threads(threads, agents, epoch_done, learn);
    let mut phases = Stopwatch::default();
    watches.iter().for_each(|of_agent| phases.add(of_agent));
    watch.add(&if threads.count() > 1 { phases.scaled_to(begun.elapsed()) } else { phases });
}

/// An AIP that learns, and from what.
struct Pupil<'a> {
    learner: Trainer<'a>,
    dataset: &'a Dataset,
    spec: &'a SourceSpec,
    /// What it corrects, and for which agent.
    constants: Option<(&'a Constants, usize)>,
    /// Number of samples of a sequence.
    steps: usize,
}

impl Pupil<'_> {
    /// Learns from the first `samples`; the others are held out.
    fn learn(
        mut self,
        room: &mut LearningBuffers,
        samples: usize,
        config: &AipConfig,
        dice: &mut Dice,
        epoch_done: &mut dyn FnMut(),
    ) -> Stopwatch {
        let mut watch = Stopwatch::default();
        let mut best = config.patience.map(BestSoFar::new);
        if let Some(best) = &mut best {
            best.note(self.held_out(room, samples, &mut watch), self.learner.values());
        }
        let mut order: Vec<usize> = (0..samples / self.steps).collect();
        for epoch in 0..config.epochs {
            order.shuffle(dice);
            for sequences in order.chunks_exact(config.batch) {
                watch.time(Phase::Bookkeeping, || {
                    room.gather(self.dataset, self.spec, self.steps, sequences.iter().copied());
                });
                watch.time(Phase::Forward, || {
                    room.forward(self.learner.network(), self.constants, self.spec);
                    room.differentiate(self.spec);
                });
                watch.time(Phase::Backward, || self.learner.network().backward(&room.gradient, &mut room.trace));
                watch.time(Phase::Adam, || {
                    if config.weight_decay > 0.0 {
                        self.learner.shrink_weights(config.learning_rate * config.weight_decay);
                    }
                    self.learner.descend(room.trace.gradient(), config.learning_rate);
                });
            }
            epoch_done();
            if let Some(best) = &mut best
                && best.note(self.held_out(room, samples, &mut watch), self.learner.values())
            {
                (epoch + 1..config.epochs).for_each(|_| epoch_done());
                break;
            }
        }
        best.iter().for_each(|best| self.learner.load(best.values()));
        watch
    }

    /// Returns the sum of the losses on the samples from `first` on.
    fn held_out(&self, room: &mut LearningBuffers, first: usize, watch: &mut Stopwatch) -> f64 {
        let held_out = Samples { dataset: self.dataset, steps: self.steps, range: first..self.dataset.len() };
        room.losses(self.learner.network(), self.constants, self.spec, held_out, watch).iter().sum()
    }
}

/// Returns the mean cross-entropy of every agent and source over some of the samples, whole episodes.
pub(super) fn losses(
    aips: &AipStack,
    datasets: &[Dataset],
    samples: Range<usize>,
    watch: &mut Stopwatch,
) -> Vec<CrossEntropies> {
    let (steps, spec) = (sequence_length(aips, datasets), &aips.sources);
    let mut room = LearningBuffers::default();
    let of_agent = |(agent, dataset)| {
        let constants = aips.constants.as_ref().map(|constants| (constants, agent));
        let samples = Samples { dataset, steps, range: samples.clone() };
        room.losses(aips.net.network(agent), constants, spec, samples, watch)
    };
    datasets.iter().enumerate().map(of_agent).collect()
}

/// Returns the number of samples that an AIP sees in one sequence: an episode if it has a memory, else 1.
fn sequence_length(aips: &AipStack, datasets: &[Dataset]) -> usize {
    if aips.net.shape().recurrent.is_some() { datasets[0].horizon } else { 1 }
}

/// Some of the samples of an agent, which are whole sequences of `steps`.
struct Samples<'a> {
    dataset: &'a Dataset,
    steps: usize,
    range: Range<usize>,
}

/// Working memory of a training, one agent after another: some sequences of its dataset, rows ordered by step, then by
/// sequence.
#[derive(Default)]
struct LearningBuffers {
    steps: usize,
    d_sets: Vec<f32>,
    sources: Vec<u8>,
    /// Part of the episode of each row.
    parts: Vec<usize>,
    /// Outputs of the network, with constants added if it corrects some.
    logits: Vec<f32>,
    /// Cleared states: sequences begin with episodes, and no episode begins within.
    states: Vec<f32>,
    starts: Vec<bool>,
    trace: Trace,
    /// Gradient of the loss by the logits.
    gradient: Vec<f32>,
}

impl LearningBuffers {
    /// Copies sequences of `steps` samples.
    fn gather(
        &mut self,
        dataset: &Dataset,
        spec: &SourceSpec,
        steps: usize,
        sequences: impl ExactSizeIterator<Item = usize> + Clone,
    ) {
        let (rows, width) = (sequences.len() * steps, dataset.d_sets.width());
        self.steps = steps;
        self.d_sets.resize(rows * width, 0.0);
        self.sources.clear();
        self.parts.clear();
        let mut d_sets = self.d_sets.chunks_exact_mut(width);
        for step in 0..steps {
            for sequence in sequences.clone() {
                let sample = sequence * steps + step;
                let d_set = d_sets.next().expect("a place per row");
                dataset.d_sets.read(sample, d_set);
                self.parts.push(part_of(spec, d_set));
                self.sources.extend_from_slice(dataset.sources.row(sample));
            }
        }
        self.d_sets.iter_mut().for_each(|x| *x = scaled(*x));
    }

    /// Runs the network. `constants`: what it corrects, and for which agent.
    fn forward(&mut self, network: Network<'_>, constants: Option<(&Constants, usize)>, spec: &SourceSpec) {
        let rows = self.sources.len() / spec.count();
        self.states.resize(rows / self.steps * network.state_width(), 0.0);
        self.starts.resize(rows, false);
        let sequences = Sequences { steps: self.steps, states: &self.states, starts: &self.starts };
        network.forward(&self.d_sets, sequences, &mut self.trace);
        self.logits.clear();
        self.logits.extend_from_slice(self.trace.output());
        if let Some((constants, agent)) = constants {
            let rows = self.logits.chunks_exact_mut(spec.logits());
            rows.zip(&self.parts).for_each(|(logits, &part)| constants.correct(agent, spec, part, logits));
        }
    }

    /// Computes the gradient of the cross-entropy, averaged over the samples and the sources.
    fn differentiate(&mut self, spec: &SourceSpec) {
        self.gradient.resize(self.logits.len(), 0.0);
        let scale = 1.0 / self.sources.len() as f32;
        let rows = self.gradient.chunks_exact_mut(spec.logits()).zip(self.logits.chunks_exact(spec.logits()));
        for ((gradient, logits), observed) in rows.zip(self.sources.chunks_exact(spec.count())) {
            sources::write_gradient(spec, logits, observed, scale, gradient);
        }
    }

    fn losses(
        &mut self,
        network: Network<'_>,
        constants: Option<(&Constants, usize)>,
        spec: &SourceSpec,
        Samples { dataset, steps, range }: Samples<'_>,
        watch: &mut Stopwatch,
    ) -> CrossEntropies {
        let mut sums = vec![0.0; spec.count()];
        let (first, last) = (range.start / steps, range.end / steps);
        let chunk = (LOSS_CHUNK / steps).max(1);
        for start in (first..last).step_by(chunk) {
            watch.time(Phase::Bookkeeping, || self.gather(dataset, spec, steps, start..last.min(start + chunk)));
            watch.time(Phase::Forward, || {
                self.forward(network, constants, spec);
                let rows = self.logits.chunks_exact(spec.logits()).zip(self.sources.chunks_exact(spec.count()));
                rows.for_each(|(logits, observed)| sources::add_cross_entropies(spec, logits, observed, &mut sums));
            });
        }
        sums.iter_mut().for_each(|sum| *sum /= range.len() as f64);
        sums
    }
}

/// The parameters with the lowest loss on held-out samples.
struct BestSoFar {
    patience: usize,
    /// Lowest loss, infinite before the first one.
    loss: f64,
    values: Vec<f32>,
    /// Number of losses since then.
    since: usize,
}

impl BestSoFar {
    /// Waits for this number of losses that are not lower, at least 1.
    fn new(patience: usize) -> BestSoFar {
        BestSoFar { patience, loss: f64::INFINITY, values: Vec::new(), since: 0 }
    }

    /// Notes the loss of some parameters. Returns whether it is time to stop.
    fn note(&mut self, loss: f64, values: &[f32]) -> bool {
        if loss < self.loss || self.values.is_empty() {
            self.loss = loss;
            self.values.clear();
            self.values.extend_from_slice(values);
            self.since = 0;
        } else {
            self.since += 1;
        }
        self.since >= self.patience
    }

    fn values(&self) -> &[f32] {
        &self.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_gives_up_after_as_many_losses_as_it_is_patient_and_keeps_the_best() {
        let mut best = BestSoFar::new(2);
        let stops = [(3.0, 0.1), (2.0, 0.2), (2.5, 0.3), (1.0, 0.4), (1.0, 0.5), (f64::NAN, 0.6)]
            .map(|(loss, value)| best.note(loss, &[value]));
        assert_eq!(stops, [false, false, false, false, false, true]);
        assert_eq!(best.values(), [0.4]);
    }
}
