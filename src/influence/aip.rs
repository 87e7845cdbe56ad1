//! The AIPs of many agents as one stack.

use rand::Rng;

use super::InfluencePredictor;
use crate::base::{AgentId, Dice, Rows, Seed};
use crate::domain::{RegionSpec, SourceSpec};
use crate::nn::{Layout, Mlp, Parameters, Trace, rows_to_tensor};

/// One feed-forward AIP per agent: d-set -> hidden layers -> logits of the influence sources.
///
/// Source: DIALS paper, appendix "Hyperparameters" (traffic); the inputs are scaled to `(x - 0.5) / 0.5` as in the
/// authors' code.
pub struct AipStack {
    agents: usize,
    sources: SourceSpec,
    net: Mlp,
    scaled: Rows<f32>,
}

fn sizes(spec: &RegionSpec, hidden: &[usize]) -> Vec<usize> {
    [&[spec.d_set_dim], hidden, &[spec.sources.logits()]].concat()
}

impl AipStack {
    /// Where the weights and biases of an AIP lie within its row.
    pub fn layout(spec: &RegionSpec, hidden: &[usize]) -> Layout {
        Mlp::layout(&sizes(spec, hidden))
    }

    /// Randomly initialised AIPs, each agent's from its own stream.
    pub fn new(agents: &[AgentId], spec: &RegionSpec, hidden: &[usize], seed: Seed) -> Self {
        AipStack {
            agents: agents.len(),
            sources: spec.sources,
            net: Mlp::new(agents, &sizes(spec, hidden), seed),
            scaled: Rows::new(0, spec.d_set_dim),
        }
    }

    pub fn agents(&self) -> usize {
        self.agents
    }

    pub fn sources(&self) -> SourceSpec {
        self.sources
    }

    pub fn parameters(&self) -> &Parameters {
        self.net.parameters()
    }

    pub fn load(&mut self, parameters: &Rows<f32>) {
        self.net.parameters_mut().load(parameters);
    }

    pub(super) fn net_mut(&mut self) -> &mut Mlp {
        &mut self.net
    }

    /// `d_sets`: rows ordered agent-major, as many for each agent; the trace holds logits `[agents, batch, logits]`.
    pub(super) fn forward(&mut self, d_sets: &Rows<f32>) -> Trace {
        if self.scaled.len() != d_sets.len() {
            self.scaled = Rows::new(d_sets.len(), d_sets.width());
        }
        for (scaled, x) in self.scaled.as_mut_slice().iter_mut().zip(d_sets.as_slice()) {
            *scaled = (x - 0.5) / 0.5;
        }
        self.net.forward(rows_to_tensor(&self.scaled, self.agents))
    }
}

impl InfluencePredictor for AipStack {
    fn forget(&mut self, _rows: &[usize]) {
        // A feed-forward AIP remembers nothing.
    }

    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>) {
        let trace = self.forward(d_set);
        let SourceSpec::Binary { sources: width } = self.sources;
        let rows = sources.as_mut_slice().chunks_exact_mut(width);
        for ((row, logits), dice) in rows.zip(trace.output().chunks_exact(width)).zip(dice) {
            for (source, &logit) in row.iter_mut().zip(logits) {
                *source = u8::from(dice.random::<f32>() < sigmoid(logit));
            }
        }
    }
}

pub(super) fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampled_frequencies_are_the_predicted_probabilities() {
        let sources = SourceSpec::Binary { sources: 2 };
        let spec = RegionSpec { obs_dim: 1, d_set_dim: 1, n_actions: 2, sources, horizon: 1 };
        let mut aip = AipStack::new(&[AgentId(0)], &spec, &[1], Seed::new(0));
        // The hidden unit is off; the output biases are logit(0.2) = -1.3863 and logit(0.9) = 2.1972.
        aip.net_mut().parameters_mut().load(&Rows::from_vec(vec![0.0, -1.0, 0.0, 0.0, -1.3863, 2.1972], 6));
        let rows = 20_000;
        let mut dice: Vec<Dice> = (0..rows).map(|copy| Seed::new(9).for_copy(copy).dice()).collect();
        let mut drawn = Rows::new(rows, 2);
        aip.sample(&Rows::new(rows, 1), &mut dice, &mut drawn);
        let frequency = |source| drawn.iter().map(|row| f64::from(row[source])).sum::<f64>() / rows as f64;
        // Standard errors: sqrt(0.16 / 20000) = 0.0028 and sqrt(0.09 / 20000) = 0.0021.
        assert!((frequency(0) - 0.2).abs() < 0.0113 && (frequency(1) - 0.9).abs() < 0.0085);
    }
}
