//! How AIPs (approximate influence predictors) learn: gradient descent on the cross-entropy, one agent after another.

use std::ops::Range;

use rand::seq::SliceRandom;

use super::aip::scaled;
use super::{AipStack, CrossEntropies, Dataset, TrainablePredictor, sources};
use crate::base::{Dice, Phase, Rows, Stopwatch, Work};
use crate::config::AipConfig;
use crate::domain::SourceSpec;
use crate::nn::{Adam, Network, Sequences, Trace};

/// Number of samples for which losses are measured at once.
const LOSS_CHUNK: usize = 512;

impl TrainablePredictor for AipStack {
    fn sources(&self) -> &SourceSpec {
        &self.sources
    }

    fn values(&self) -> Rows<f32> {
        self.parameters().values().clone()
    }

    fn load(&mut self, values: &Rows<f32>) {
        self.net.parameters_mut().load(values);
    }

    fn learn(
        &mut self,
        datasets: &[Dataset],
        samples: usize,
        config: &AipConfig,
        dice: &mut [Dice],
        work: Work<'_, f64>,
    ) {
        learn(self, datasets, samples, config, dice, work);
    }

    fn cross_entropies(
        &self,
        datasets: &[Dataset],
        samples: Range<usize>,
        watch: &mut Stopwatch,
    ) -> Vec<CrossEntropies> {
        cross_entropies(self, datasets, samples, watch)
    }
}

/// Trains every agent's AIP on the first `samples` of its own dataset.
///
/// Adam starts from zero and the incomplete last batch of an epoch is dropped, as in the authors' code. The weights
/// continue from the previous training. AIPs with memory are trained on whole episodes, others on single samples.
/// Minibatches are drawn from `dice`, one per agent.
fn learn(
    aips: &mut AipStack,
    datasets: &[Dataset],
    samples: usize,
    config: &AipConfig,
    dice: &mut [Dice],
    work: Work<'_, f64>,
) {
    let Work { watch, progress } = work;
    let (steps, spec) = (sequence_length(aips, datasets), &aips.sources().clone());
    // Sequences of `steps` samples each.
    let batches = samples / steps / config.batch;
    let mut room = LearningBuffers::default();
    let mut adam = Adam::new(aips.parameters());
    let learners = aips.learners(&mut adam, (config.epochs * batches) as u32);
    for (index, ((mut learner, dataset), dice)) in learners.into_iter().zip(datasets).zip(dice).enumerate() {
        let mut order: Vec<usize> = (0..samples / steps).collect();
        for epoch in 0..config.epochs {
            order.shuffle(dice);
            for sequences in order.chunks_exact(config.batch) {
                watch.time(Phase::Bookkeeping, || room.gather(dataset, steps, sequences.iter().copied()));
                watch.time(Phase::Forward, || {
                    room.forward(learner.network(), spec);
                    room.differentiate(spec);
                });
                watch.time(Phase::Backward, || learner.network().backward(&room.gradient, &mut room.trace));
                watch.time(Phase::Adam, || learner.descend(room.trace.gradient(), config.learning_rate));
            }
            progress((index as f64 + (epoch + 1) as f64 / config.epochs as f64) / datasets.len() as f64);
        }
    }
}

/// Returns the mean cross-entropy of every agent and source over some of the samples, whole episodes.
fn cross_entropies(
    aips: &AipStack,
    datasets: &[Dataset],
    samples: Range<usize>,
    watch: &mut Stopwatch,
) -> Vec<CrossEntropies> {
    let (steps, spec) = (sequence_length(aips, datasets), aips.sources());
    let mut room = LearningBuffers::default();
    let of_agent = |(agent, dataset)| {
        room.cross_entropies(aips.net().network(agent), spec, dataset, steps, samples.clone(), watch)
    };
    datasets.iter().enumerate().map(of_agent).collect()
}

/// Returns the number of samples that an AIP sees in one sequence: an episode if it has a memory, else 1.
fn sequence_length(aips: &AipStack, datasets: &[Dataset]) -> usize {
    if aips.net().shape().recurrent.is_some() { datasets[0].horizon } else { 1 }
}

/// Working memory of a training, one agent after another: some sequences of its dataset, rows ordered by step, then by
/// sequence.
#[derive(Default)]
struct LearningBuffers {
    steps: usize,
    d_sets: Vec<f32>,
    sources: Vec<u8>,
    /// Cleared states: sequences begin with episodes, and no episode begins within.
    states: Vec<f32>,
    starts: Vec<bool>,
    trace: Trace,
    /// Gradient of the loss by the logits.
    gradient: Vec<f32>,
}

impl LearningBuffers {
    /// Copies sequences of `steps` samples.
    fn gather(&mut self, dataset: &Dataset, steps: usize, sequences: impl ExactSizeIterator<Item = usize> + Clone) {
        let (rows, width) = (sequences.len() * steps, dataset.d_sets.width());
        self.steps = steps;
        self.d_sets.resize(rows * width, 0.0);
        self.sources.clear();
        let mut d_sets = self.d_sets.chunks_exact_mut(width);
        for step in 0..steps {
            for sequence in sequences.clone() {
                let sample = sequence * steps + step;
                dataset.d_sets.read(sample, d_sets.next().expect("a place per row"));
                self.sources.extend_from_slice(dataset.sources.row(sample));
            }
        }
        self.d_sets.iter_mut().for_each(|x| *x = scaled(*x));
    }

    fn forward(&mut self, network: Network<'_>, spec: &SourceSpec) {
        let rows = self.sources.len() / spec.count();
        self.states.resize(rows / self.steps * network.state_width(), 0.0);
        self.starts.resize(rows, false);
        let sequences = Sequences { steps: self.steps, states: &self.states, starts: &self.starts };
        network.forward(&self.d_sets, sequences, &mut self.trace);
    }

    /// Computes the gradient of the cross-entropy, averaged over the samples and the sources.
    fn differentiate(&mut self, spec: &SourceSpec) {
        let logits = self.trace.output();
        self.gradient.resize(logits.len(), 0.0);
        let scale = 1.0 / self.sources.len() as f32;
        let rows = self.gradient.chunks_exact_mut(spec.logits()).zip(logits.chunks_exact(spec.logits()));
        for ((gradient, logits), observed) in rows.zip(self.sources.chunks_exact(spec.count())) {
            sources::write_gradient(spec, logits, observed, scale, gradient);
        }
    }

    /// Returns the mean cross-entropy of every source over some of the samples, which are whole sequences of `steps`.
    fn cross_entropies(
        &mut self,
        network: Network<'_>,
        spec: &SourceSpec,
        dataset: &Dataset,
        steps: usize,
        samples: Range<usize>,
        watch: &mut Stopwatch,
    ) -> CrossEntropies {
        let mut sums = vec![0.0; spec.count()];
        let (first, last) = (samples.start / steps, samples.end / steps);
        let chunk = (LOSS_CHUNK / steps).max(1);
        for start in (first..last).step_by(chunk) {
            watch.time(Phase::Bookkeeping, || self.gather(dataset, steps, start..last.min(start + chunk)));
            watch.time(Phase::Forward, || {
                self.forward(network, spec);
                let rows = self.trace.output().chunks_exact(spec.logits()).zip(self.sources.chunks_exact(spec.count()));
                rows.for_each(|(logits, observed)| sources::add_cross_entropies(spec, logits, observed, &mut sums));
            });
        }
        sums.iter_mut().for_each(|sum| *sum /= samples.len() as f64);
        sums
    }
}
