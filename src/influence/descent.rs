//! How AIPs learn: gradient descent on the cross-entropy, all agents of a stack at once.

use std::ops::Range;

use rand::seq::SliceRandom;

use super::{AipStack, CrossEntropies, Dataset, TrainablePredictor, sources};
use crate::base::{AgentId, Dice, Rows, Seed};
use crate::config::AipConfig;
use crate::nn::Adam;

/// Samples per agent for which losses are measured at once.
const LOSS_CHUNK: usize = 512;

/// Trains every agent's AIP on the first `samples` of its own dataset.
///
/// Adam starts fresh and the incomplete last batch of an epoch is dropped, as in the authors' code; the weights go on
/// from the previous training. AIPs with memory are trained on whole episodes, others on single samples. Minibatches
/// are drawn from `seed`, each agent's from its own stream.
pub fn learn(
    aips: &mut AipStack,
    agents: &[AgentId],
    datasets: &[Dataset],
    samples: usize,
    config: &AipConfig,
    seed: Seed,
    progress: &mut dyn FnMut(f64),
) {
    let steps = sequence_length(aips, datasets);
    let mut dice: Vec<Dice> = agents.iter().map(|&agent| seed.for_agent(agent).dice()).collect();
    let mut adam = Adam::new(aips.parameters());
    // Sequences of `steps` samples each.
    let mut order: Vec<Vec<usize>> = vec![(0..samples / steps).collect(); agents.len()];
    let mut minibatch = Minibatch::new(agents.len(), config.batch, steps, &datasets[0]);
    for epoch in 0..config.epochs {
        order.iter_mut().zip(&mut dice).for_each(|(order, dice)| order.shuffle(dice));
        for batch in 0..samples / steps / config.batch {
            minibatch.gather(datasets, |agent, i| order[agent][batch * config.batch + i]);
            minibatch.descend(aips, &mut adam, config.learning_rate);
        }
        progress((epoch + 1) as f64 / config.epochs as f64);
    }
}

/// Samples that an AIP sees in one go: an episode where it has a memory.
fn sequence_length(aips: &AipStack, datasets: &[Dataset]) -> usize {
    if aips.net().shape().recurrent.is_some() { datasets[0].horizon } else { 1 }
}

/// Some sequences of every agent; rows ordered agent, step, sequence.
struct Minibatch {
    sequences: usize,
    steps: usize,
    d_sets: Rows<f32>,
    sources: Rows<u8>,
}

impl Minibatch {
    fn new(agents: usize, sequences: usize, steps: usize, like: &Dataset) -> Self {
        let rows = agents * sequences * steps;
        Minibatch {
            sequences,
            steps,
            d_sets: Rows::new(rows, like.d_sets.width()),
            sources: Rows::new(rows, like.sources.width()),
        }
    }

    /// Copies sequence `pick(agent, i)` of every agent's dataset to the i-th of the agent.
    fn gather(&mut self, datasets: &[Dataset], pick: impl Fn(usize, usize) -> usize) {
        for (agent, dataset) in datasets.iter().enumerate() {
            for i in 0..self.sequences {
                let sequence = pick(agent, i);
                for step in 0..self.steps {
                    let row = (agent * self.steps + step) * self.sequences + i;
                    let sample = sequence * self.steps + step;
                    dataset.d_sets.read(sample, self.d_sets.row_mut(row));
                    self.sources.row_mut(row).copy_from_slice(dataset.sources.row(sample));
                }
            }
        }
    }

    /// One gradient step on the cross-entropy, averaged over the samples and the sources of each agent.
    fn descend(&self, aips: &mut AipStack, adam: &mut Adam, learning_rate: f64) {
        let spec = aips.sources();
        let trace = aips.forward(&self.d_sets, self.steps);
        let scale = 1.0 / (self.sequences * self.steps * spec.count()) as f32;
        let mut gradient = vec![0.0; trace.output().len()];
        let rows = gradient.chunks_exact_mut(spec.logits()).zip(trace.output().chunks_exact(spec.logits()));
        for ((gradient, logits), observed) in rows.zip(self.sources.iter()) {
            sources::write_gradient(spec, logits, observed, scale, gradient);
        }
        let net = aips.net_mut();
        net.backward(&trace, &gradient);
        adam.step(net.parameters_mut(), learning_rate);
    }
}

/// Mean cross-entropy of every agent and source over some of the samples, whole episodes.
pub fn cross_entropies(aips: &AipStack, datasets: &[Dataset], samples: Range<usize>) -> Vec<CrossEntropies> {
    let (spec, steps) = (aips.sources(), sequence_length(aips, datasets));
    let mut sums = vec![vec![0.0; spec.count()]; datasets.len()];
    let (first, last) = (samples.start / steps, samples.end / steps);
    let chunk = (LOSS_CHUNK / steps).max(1);
    for start in (first..last).step_by(chunk) {
        let mut minibatch = Minibatch::new(datasets.len(), chunk.min(last - start), steps, &datasets[0]);
        minibatch.gather(datasets, |_, i| start + i);
        let trace = aips.forward(&minibatch.d_sets, steps);
        let rows = trace.output().chunks_exact(spec.logits()).zip(minibatch.sources.iter());
        for (row, (logits, observed)) in rows.enumerate() {
            let agent = row / (minibatch.sequences * steps);
            sources::add_cross_entropies(spec, logits, observed, &mut sums[agent]);
        }
    }
    let count = samples.len() as f64;
    sums.iter_mut().flatten().for_each(|sum| *sum /= count);
    sums
}
