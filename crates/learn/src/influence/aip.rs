//! The approximate influence predictors (AIPs) of many agents as one stack.

use super::{CorrectingAips, InfluencePredictor, PredictorKind, TrainablePredictor, sources};
use crate::config::AipConfig;
use dials_core::base::{AgentId, Dice, Rows, Seed};
use dials_core::domain::{RegionSpec, Result, SourceSpec};
use stacknets::{Adam, Layout, Parameters, Shape, Stack, States, Trainer};

/// One AIP per agent: d-set -> GRU, if any -> hidden layers -> logits of the influence sources.
///
/// Source: DIALS paper, appendix "Hyperparameters" (traffic: 128 and 128; warehouse: GRU 64 and 64). The inputs are
/// scaled to `(x - 0.5) / 0.5` as in the authors' code.
pub struct AipStack {
    pub(super) sources: SourceSpec,
    pub(super) net: Stack,
    /// Hidden states of the rows that it samples for.
    states: States,
}

impl AipStack {
    /// Returns the shape of an AIP.
    pub fn shape(spec: &RegionSpec, config: &AipConfig) -> Shape {
        Shape {
            inputs: spec.d_set_dim,
            recurrent: config.recurrent,
            hidden: config.hidden.clone(),
            outputs: spec.sources.logits(),
            apart: 0,
        }
    }

    /// Makes AIPs with random parameters, each agent's from its own stream.
    pub fn new(agents: &[AgentId], spec: &RegionSpec, config: &AipConfig, seed: Seed) -> Self {
        let net = Stack::new(AipStack::shape(spec, config), seed.for_agents(agents));
        AipStack { sources: spec.sources.clone(), states: net.states(0), net }
    }

    pub(super) fn parameters(&self) -> &Parameters {
        self.net.parameters()
    }

    pub(super) fn net(&self) -> &Stack {
        &self.net
    }

    /// Makes the last layer zero, so that all outputs are.
    pub(super) fn silence(&mut self) {
        let layout = self.net.parameters().layout();
        let places: Vec<_> = layout.blocks(1).map(|(_, _, place)| place).collect();
        let last = places[places.len() - 2].start..layout.width();
        let values = self.net.parameters_mut().values_mut();
        (0..values.len()).for_each(|agent| values.row_mut(agent)[last.clone()].fill(0.0));
    }

    /// Runs one step of all rows. Returns the logits.
    pub(super) fn outputs(&mut self, d_set: &Rows<f32>) -> Rows<f32> {
        let inputs = Rows::from_vec(d_set.as_slice().iter().map(|&x| scaled(x)).collect(), d_set.width());
        self.net.step(&inputs, &mut self.states)
    }

    /// Returns every agent's AIP with its part of the optimiser, for `steps` gradient steps each.
    pub(super) fn learners<'a>(&'a mut self, adam: &'a mut Adam, steps: u32) -> Vec<Trainer<'a>> {
        adam.trainers(&mut self.net, steps)
    }
}

/// Scales a value of a d-set for the network.
pub(super) fn scaled(x: f32) -> f32 {
    (x - 0.5) / 0.5
}

impl InfluencePredictor for AipStack {
    fn begin(&mut self, rows: usize) {
        self.states = self.net.states(rows);
    }

    fn forget(&mut self, rows: &[usize]) {
        rows.iter().for_each(|&row| self.states.clear(row));
    }

    fn watch(&mut self, d_set: &Rows<f32>) {
        // Without memory there is nothing to remember.
        if !self.states.as_slice().is_empty() {
            self.outputs(d_set);
        }
    }

    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>) {
        let logits = self.outputs(d_set);
        let rows = sources.as_mut_slice().chunks_exact_mut(self.sources.count());
        for ((row, logits), dice) in rows.zip(logits.iter()).zip(dice) {
            sources::sample(&self.sources, logits, dice, row);
        }
    }
}

/// AIPs that are trained, alone or as corrections of marginals.
pub(super) struct Aips;

impl PredictorKind for Aips {
    fn learns(&self) -> bool {
        true
    }

    fn reads(&self, _key: &str) -> bool {
        true
    }

    fn make(
        &self,
        agents: &[AgentId],
        spec: &RegionSpec,
        config: &AipConfig,
        seed: Seed,
    ) -> Box<dyn TrainablePredictor> {
        match config.correct_marginals {
            true => Box::new(CorrectingAips::new(agents, spec, config, seed)),
            false => Box::new(AipStack::new(agents, spec, config, seed)),
        }
    }

    fn layout(&self, spec: &RegionSpec, config: &AipConfig) -> Layout {
        match config.correct_marginals {
            true => CorrectingAips::layout(spec, config),
            false => AipStack::shape(spec, config).layout(),
        }
    }

    fn check_values(&self, spec: &RegionSpec, config: &AipConfig, values: &[f32]) -> Result<()> {
        if config.correct_marginals { CorrectingAips::check(&spec.sources, values) } else { Ok(()) }
    }

    fn sampling_flops(&self, spec: &RegionSpec, config: &AipConfig) -> f64 {
        AipStack::shape(spec, config).forward_flops()
    }
}

/// Random AIPs that are never trained.
pub(super) struct UntrainedAips;

impl PredictorKind for UntrainedAips {
    fn learns(&self) -> bool {
        false
    }

    fn reads(&self, key: &str) -> bool {
        ["hidden", "recurrent"].contains(&key)
    }

    fn make(
        &self,
        agents: &[AgentId],
        spec: &RegionSpec,
        config: &AipConfig,
        seed: Seed,
    ) -> Box<dyn TrainablePredictor> {
        Box::new(AipStack::new(agents, spec, config, seed))
    }

    fn layout(&self, spec: &RegionSpec, config: &AipConfig) -> Layout {
        AipStack::shape(spec, config).layout()
    }

    fn sampling_flops(&self, spec: &RegionSpec, config: &AipConfig) -> f64 {
        AipStack::shape(spec, config).forward_flops()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampled_frequencies_are_the_predicted_probabilities() {
        let sources = SourceSpec::bits(2);
        let spec =
            RegionSpec { obs_dim: 1, d_set_dim: 1, n_actions: 2, masks: false, sources, horizon: 1, local_horizon: 1 };
        let mut aip =
            AipStack::new(&[AgentId(0)], &spec, &AipConfig { hidden: vec![1], ..AipConfig::default() }, Seed::new(0));
        // The hidden unit is off; the output biases are logit(0.2) = -1.3863 and logit(0.9) = 2.1972.
        aip.net.parameters_mut().load(&Rows::from_vec(vec![0.0, -1.0, 0.0, 0.0, -1.3863, 2.1972], 6));
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
