//! The AIPs of many agents as one stack.

use std::ops::Range;

use super::{CrossEntropies, Dataset, InfluencePredictor, TrainablePredictor, descent, sources};
use crate::base::{AgentId, Dice, Rows, Seed};
use crate::config::AipConfig;
use crate::domain::{RegionSpec, SourceSpec};
use crate::nn::{Net, Parameters, Sequences, Shape, States, Trace};

/// One AIP per agent: d-set -> GRU, if any -> hidden layers -> logits of the influence sources.
///
/// Source: DIALS paper, appendix "Hyperparameters" (traffic: 128 and 128; warehouse: GRU 64 and 64); the inputs are
/// scaled to `(x - 0.5) / 0.5` as in the authors' code.
pub struct AipStack {
    sources: SourceSpec,
    net: Net,
    /// Of the rows that it samples for.
    states: States,
}

impl AipStack {
    /// What an AIP looks like.
    pub fn shape(spec: &RegionSpec, config: &AipConfig) -> Shape {
        Shape {
            inputs: spec.d_set_dim,
            recurrent: config.recurrent,
            hidden: config.hidden.clone(),
            outputs: spec.sources.logits(),
        }
    }

    /// Randomly initialised AIPs, each agent's from its own stream.
    pub fn new(agents: &[AgentId], spec: &RegionSpec, config: &AipConfig, seed: Seed) -> Self {
        let net = Net::new(agents, AipStack::shape(spec, config), seed);
        AipStack { sources: spec.sources, states: net.states(0), net }
    }

    pub(super) fn parameters(&self) -> &Parameters {
        self.net.parameters()
    }

    pub(super) fn net(&self) -> &Net {
        &self.net
    }

    pub(super) fn net_mut(&mut self) -> &mut Net {
        &mut self.net
    }

    /// Runs over sequences that begin with episodes. `d_sets`: rows ordered agent, step, sequence; the trace holds
    /// logits in the same order.
    pub(super) fn forward(&self, d_sets: &Rows<f32>, steps: usize) -> Trace {
        let states = self.net.states(d_sets.len() / steps);
        let starts = vec![false; d_sets.len()];
        self.net.forward(&scaled(d_sets), &Sequences { steps, states: &states, starts: &starts })
    }
}

fn scaled(d_sets: &Rows<f32>) -> Rows<f32> {
    let values = d_sets.as_slice().iter().map(|x| (x - 0.5) / 0.5).collect();
    Rows::from_vec(values, d_sets.width())
}

impl InfluencePredictor for AipStack {
    fn begin(&mut self, rows: usize) {
        self.states = self.net.states(rows);
    }

    fn forget(&mut self, rows: &[usize]) {
        rows.iter().for_each(|&row| self.states.clear(row));
    }

    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>) {
        let trace = self.net.step(&scaled(d_set), &mut self.states);
        let (count, logits) = (self.sources.count(), self.sources.logits());
        let rows = sources.as_mut_slice().chunks_exact_mut(count);
        for ((row, logits), dice) in rows.zip(trace.output().chunks_exact(logits)).zip(dice) {
            sources::sample(self.sources, logits, dice, row);
        }
    }
}

impl TrainablePredictor for AipStack {
    fn sources(&self) -> SourceSpec {
        self.sources
    }

    fn values(&self) -> Rows<f32> {
        self.parameters().to_rows()
    }

    fn load(&mut self, values: &Rows<f32>) {
        self.net.parameters_mut().load(values);
    }

    fn learn(
        &mut self,
        agents: &[AgentId],
        datasets: &[Dataset],
        samples: usize,
        config: &AipConfig,
        seed: Seed,
        progress: &mut dyn FnMut(f64),
    ) {
        descent::learn(self, agents, datasets, samples, config, seed, progress);
    }

    fn cross_entropies(&self, datasets: &[Dataset], samples: Range<usize>) -> Vec<CrossEntropies> {
        descent::cross_entropies(self, datasets, samples)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampled_frequencies_are_the_predicted_probabilities() {
        let sources = SourceSpec::Binary { sources: 2 };
        let spec = RegionSpec { obs_dim: 1, d_set_dim: 1, n_actions: 2, sources, horizon: 1 };
        let mut aip =
            AipStack::new(&[AgentId(0)], &spec, &AipConfig { hidden: vec![1], ..AipConfig::default() }, Seed::new(0));
        // The hidden unit is off; the output biases are logit(0.2) = -1.3863 and logit(0.9) = 2.1972.
        aip.net_mut().parameters_mut().load(&Rows::from_vec(vec![0.0, -1.0, 0.0, 0.0, -1.3863, 2.1972], 6));
        let rows = 20_000;
        let mut dice: Vec<Dice> = (0..rows).map(|copy| Seed::new(9).for_copy(copy).dice()).collect();
        let mut drawn = Rows::new(rows, 2);
        aip.begin(rows);
        aip.sample(&Rows::new(rows, 1), &mut dice, &mut drawn);
        let frequency = |source| drawn.iter().map(|row| f64::from(row[source])).sum::<f64>() / rows as f64;
        // Standard errors: sqrt(0.16 / 20000) = 0.0028 and sqrt(0.09 / 20000) = 0.0021.
        assert!((frequency(0) - 0.2).abs() < 0.0113 && (frequency(1) - 0.9).abs() < 0.0085);
    }
}
