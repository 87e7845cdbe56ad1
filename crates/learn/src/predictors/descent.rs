//! How AIPs (approximate influence predictors) learn: gradient descent on the cross-entropy, one agent after another.

use std::ops::Range;

use rand::seq::SliceRandom;

use super::aip::scaled;
use super::best::BestSoFar;
use super::parts::part_of;
use super::{AipStack, CrossEntropies, Dataset, TrainablePredictor, sources};
use crate::config::AipConfig;
use dials_core::base::{Dice, Phase, Rows, Stopwatch, Work};
use dials_core::domain::{SourceSpec, logits_of};
use stacknets::{Adam, Network, Sequences, Trace};

/// Number of samples for which losses are measured at once.
const LOSS_CHUNK: usize = 512;

/// What is added to the outputs of networks: see [`super::correcting`]. One row per agent each.
#[derive(Clone, Copy)]
pub(super) struct Constants<'a> {
    /// Logits of the constants, `[parts, logits]`.
    pub(crate) logits: &'a Rows<f32>,
    /// 1 for a source that listens to the network, 0 for one that keeps its constants, `[sources]`.
    pub(crate) listens: &'a Rows<f32>,
}

impl<'a> Constants<'a> {
    fn of_agent(self, agent: usize) -> ConstantsOfAgent<'a> {
        ConstantsOfAgent { logits: self.logits.row(agent), listens: self.listens.row(agent) }
    }
}

/// The constants of one agent.
#[derive(Clone, Copy)]
pub(super) struct ConstantsOfAgent<'a> {
    logits: &'a [f32],
    listens: &'a [f32],
}

impl<'a> ConstantsOfAgent<'a> {
    /// Makes the constants of one agent; see [`Constants`].
    pub(super) fn new(logits: &'a [f32], listens: &'a [f32]) -> ConstantsOfAgent<'a> {
        ConstantsOfAgent { logits, listens }
    }

    /// Adds the constants of a part of the episode to the outputs of a network, which become the logits of one sample.
    pub(super) fn correct(self, spec: &SourceSpec, part: usize, outputs: &mut [f32]) {
        let constants = &self.logits[part * spec.logits()..(part + 1) * spec.logits()];
        let widths = spec.classes.iter().map(|&classes| logits_of(classes));
        let listens = self.listens.iter().zip(widths).flat_map(|(&listens, width)| std::iter::repeat_n(listens, width));
        for ((output, constant), listens) in outputs.iter_mut().zip(constants).zip(listens) {
            *output = constant + listens * *output;
        }
    }
}

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
        learn(self, None, datasets, samples, config, dice, work);
    }

    fn cross_entropies(
        &self,
        datasets: &[Dataset],
        samples: Range<usize>,
        watch: &mut Stopwatch,
    ) -> Vec<CrossEntropies> {
        cross_entropies(self, None, datasets, samples, watch)
    }
}

/// Trains every agent's AIP on the first `samples` of its own dataset.
///
/// Adam starts from zero and the incomplete last batch of an epoch is dropped, as in the authors' code. The weights
/// continue from the previous training. AIPs with memory are trained on whole episodes, others on single samples.
/// Minibatches are drawn from `dice`, one per agent. The samples after the first ones decide when to stop early, if the
/// config says so. `constants`: what is added to the outputs, if anything; then all sources listen.
pub(super) fn learn(
    aips: &mut AipStack,
    constants: Option<Constants<'_>>,
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
        let constants = constants.map(|constants| constants.of_agent(index));
        let mut best = config.patience.map(BestSoFar::new);
        let held_out = |room: &mut LearningBuffers, network: Network<'_>, watch: &mut Stopwatch| -> f64 {
            let held_out = Samples { dataset, steps, range: samples..dataset.len() };
            room.cross_entropies(network, constants, spec, held_out, watch).iter().sum()
        };
        if let Some(best) = &mut best {
            best.note(held_out(&mut room, learner.network(), watch), learner.values());
        }
        let mut order: Vec<usize> = (0..samples / steps).collect();
        for epoch in 0..config.epochs {
            order.shuffle(dice);
            for sequences in order.chunks_exact(config.batch) {
                watch.time(Phase::Bookkeeping, || room.gather(dataset, spec, steps, sequences.iter().copied()));
                watch.time(Phase::Forward, || {
                    room.forward(learner.network(), constants, spec);
                    room.differentiate(spec);
                });
                watch.time(Phase::Backward, || learner.network().backward(&room.gradient, &mut room.trace));
                watch.time(Phase::Adam, || {
                    if config.weight_decay > 0.0 {
                        learner.shrink_weights(config.learning_rate * config.weight_decay);
                    }
                    learner.descend(room.trace.gradient(), config.learning_rate);
                });
            }
            progress((index as f64 + (epoch + 1) as f64 / config.epochs as f64) / datasets.len() as f64);
            if let Some(best) = &mut best
                && best.note(held_out(&mut room, learner.network(), watch), learner.values())
            {
                break;
            }
        }
        best.iter().for_each(|best| learner.load(best.values()));
    }
}

/// Returns the mean cross-entropy of every agent and source over some of the samples, whole episodes.
pub(super) fn cross_entropies(
    aips: &AipStack,
    constants: Option<Constants<'_>>,
    datasets: &[Dataset],
    samples: Range<usize>,
    watch: &mut Stopwatch,
) -> Vec<CrossEntropies> {
    let (steps, spec) = (sequence_length(aips, datasets), aips.sources());
    let mut room = LearningBuffers::default();
    let of_agent = |(agent, dataset)| {
        let constants = constants.map(|constants| constants.of_agent(agent));
        let samples = Samples { dataset, steps, range: samples.clone() };
        room.cross_entropies(aips.net().network(agent), constants, spec, samples, watch)
    };
    datasets.iter().enumerate().map(of_agent).collect()
}

/// Returns the number of samples that an AIP sees in one sequence: an episode if it has a memory, else 1.
fn sequence_length(aips: &AipStack, datasets: &[Dataset]) -> usize {
    if aips.net().shape().recurrent.is_some() { datasets[0].horizon } else { 1 }
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
    /// Outputs of the network with constants added; empty if there are none.
    corrected: Vec<f32>,
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

    fn forward(&mut self, network: Network<'_>, constants: Option<ConstantsOfAgent<'_>>, spec: &SourceSpec) {
        let rows = self.sources.len() / spec.count();
        self.states.resize(rows / self.steps * network.state_width(), 0.0);
        self.starts.resize(rows, false);
        let sequences = Sequences { steps: self.steps, states: &self.states, starts: &self.starts };
        network.forward(&self.d_sets, sequences, &mut self.trace);
        self.corrected.clear();
        if let Some(constants) = constants {
            self.corrected.extend_from_slice(self.trace.output());
            let rows = self.corrected.chunks_exact_mut(spec.logits());
            rows.zip(&self.parts).for_each(|(logits, &part)| constants.correct(spec, part, logits));
        }
    }

    /// Returns the logits of the last forward pass.
    fn logits(&self) -> &[f32] {
        if self.corrected.is_empty() { self.trace.output() } else { &self.corrected }
    }

    /// Computes the gradient of the cross-entropy, averaged over the samples and the sources.
    fn differentiate(&mut self, spec: &SourceSpec) {
        let LearningBuffers { trace, corrected, gradient, .. } = self;
        let logits = if corrected.is_empty() { trace.output() } else { corrected };
        gradient.resize(logits.len(), 0.0);
        let scale = 1.0 / self.sources.len() as f32;
        let rows = gradient.chunks_exact_mut(spec.logits()).zip(logits.chunks_exact(spec.logits()));
        for ((gradient, logits), observed) in rows.zip(self.sources.chunks_exact(spec.count())) {
            sources::write_gradient(spec, logits, observed, scale, gradient);
        }
    }

    /// Returns the mean cross-entropy of every source over some samples.
    fn cross_entropies(
        &mut self,
        network: Network<'_>,
        constants: Option<ConstantsOfAgent<'_>>,
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
                let rows = self.logits().chunks_exact(spec.logits()).zip(self.sources.chunks_exact(spec.count()));
                rows.for_each(|(logits, observed)| sources::add_cross_entropies(spec, logits, observed, &mut sums));
            });
        }
        sums.iter_mut().for_each(|sum| *sum /= range.len() as f64);
        sums
    }
}
