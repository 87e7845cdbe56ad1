//! AIPs that predict the frequencies of events, without training.
//!
//! A benchmark trains AIPs only for a moment. Such AIPs send many times too many cars into the local simulators, whose
//! steps then take many times too long. Constant AIPs send as many cars as the GS, at the same cost per sample.

use dials_core::domain::{RegionSpec, SourceSpec};
use dials_learn::config::AipConfig;
use dials_learn::predictors::{AipStack, Dataset, frequencies};

/// Half an event, so that an unseen event is not impossible.
const HALF: f64 = 0.5;

/// Makes an agent's AIP predict the frequencies in its dataset for any input. The weights of the last layer become
/// zero, and its biases the logits of the frequencies. An AIP that corrects constants corrects them by nothing, and these
/// are the logits. `aip`: what it has learnt, as [`dials_learn::predictors::PredictorKind::layout`] describes it.
pub(super) fn predict_marginals(aip: &mut [f32], spec: &RegionSpec, config: &AipConfig, dataset: &Dataset) {
    let network = AipStack::shape(spec, config).layout();
    let blocks: Vec<_> = network.blocks(1).map(|(_, _, place)| place).collect();
    let [.., weight, bias] = &blocks[..] else { unreachable!("a network has a last layer") };
    let logits = logits(&spec.sources, dataset);
    aip[weight.clone()].fill(0.0);
    if config.correct_marginals {
        aip[bias.clone()].fill(0.0);
        let constants = network.width()..aip.len() - spec.sources.count();
        aip[constants].chunks_exact_mut(logits.len()).for_each(|of_part| of_part.copy_from_slice(&logits));
    } else {
        aip[bias.clone()].copy_from_slice(&logits);
    }
}

fn logits(spec: &SourceSpec, dataset: &Dataset) -> Vec<f32> {
    let mut logits = Vec::with_capacity(spec.logits());
    for shares in frequencies(spec, dataset, 0..dataset.len()) {
        let log_count = |share: f64| (share * dataset.len() as f64 + HALF).ln() as f32;
        match shares[..] {
            [zeros, ones] => logits.push(log_count(ones) - log_count(zeros)),
            _ => logits.extend(shares.into_iter().map(log_count)),
        }
    }
    logits
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::base::{AgentId, Dice, Rows, Seed};
    use dials_learn::config::Predictor;

    /// Draws from AIPs that predict the marginals of a dataset in which a quarter of the samples have class 1.
    fn share_of_ones(sources: SourceSpec, correct_marginals: bool) -> f64 {
        let (horizon, local_horizon) = (1000, 1000);
        let spec = RegionSpec {
            obs_dim: 2,
            d_set_dim: 2,
            n_actions: 2,
            sets: None,
            masks: false,
            sources,
            horizon,
            local_horizon,
        };
        let mut dataset = Dataset::new(&spec);
        (0..1000).for_each(|sample| dataset.push(&[1.0, 0.0], &[u8::from(sample % 4 == 0)]));
        let config = AipConfig { hidden: vec![5], correct_marginals, ..AipConfig::default() };
        let mut aips = Predictor::Network.kind().make(&[AgentId(0)], &spec, &config, Seed::new(3));
        let mut parameters = aips.values();
        predict_marginals(parameters.row_mut(0), &spec, &config, &dataset);
        aips.load(&parameters);
        let rows = 20_000;
        let mut dice: Vec<Dice> = (0..rows).map(|copy| Seed::new(9).for_copy(copy).dice()).collect();
        let mut drawn = Rows::new(rows, 1);
        aips.begin(rows).unwrap();
        aips.sample(&Rows::new(rows, 2), &mut dice, &mut drawn).unwrap();
        drawn.iter().filter(|row| row[0] == 1).count() as f64 / rows as f64
    }

    #[test]
    fn sources_come_as_often_as_in_the_dataset() {
        // Standard error: sqrt(0.1875 / 20000) = 0.003.
        let in_parts = SourceSpec { parts: 2, ..SourceSpec::bits(1) };
        for sources in [SourceSpec::bits(1), SourceSpec { classes: vec![3], parts: 0 }, in_parts] {
            for correct_marginals in [false, true] {
                let share = share_of_ones(sources.clone(), correct_marginals);
                assert!((share - 0.25).abs() < 0.012, "{share}");
            }
        }
    }
}
