//! AIPs that predict how often things happen, without having been trained for it.
//!
//! A benchmark trains AIPs for a moment only, and such AIPs send many times too many cars into the local simulators,
//! whose steps are then many times too slow. Constant ones send as many as the GS does, at the same cost per sample.

use crate::base::Rows;
use crate::domain::SourceSpec;
use crate::influence::{Dataset, frequencies};
use crate::nn::Layout;

/// Half an event: what was never seen is not impossible.
const HALF: f64 = 0.5;

/// Makes every agent's AIP predict the frequencies in its dataset whatever it sees: the weights of the last layer become
/// zero and its biases the logits of the frequencies. `aips`: one row of parameters per agent.
pub fn predict_marginals(aips: &mut Rows<f32>, layout: &Layout, spec: SourceSpec, datasets: &[Dataset]) {
    let blocks: Vec<_> = layout.blocks(datasets.len()).map(|(_, _, place)| place).collect();
    let [.., weight, bias] = &blocks[..] else { unreachable!("a network has a last layer") };
    for (agent, dataset) in datasets.iter().enumerate() {
        let row = aips.row_mut(agent);
        row[weight.clone()].fill(0.0);
        row[bias.clone()].copy_from_slice(&logits(spec, dataset));
    }
}

fn logits(spec: SourceSpec, dataset: &Dataset) -> Vec<f32> {
    let mut logits = Vec::with_capacity(spec.logits());
    for shares in frequencies(spec, dataset, 0..dataset.len()) {
        let log_counts = shares.into_iter().map(|share| (share * dataset.len() as f64 + HALF).ln() as f32);
        match spec {
            SourceSpec::Binary { .. } => {
                let [zeros, ones] = log_counts.collect::<Vec<_>>()[..] else { unreachable!("a bit has two values") };
                logits.push(ones - zeros);
            }
            SourceSpec::Categorical { .. } => logits.extend(log_counts),
        }
    }
    logits
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{AgentId, Dice, Seed};
    use crate::config::AipConfig;
    use crate::domain::RegionSpec;
    use crate::influence::{AipStack, InfluencePredictor, TrainablePredictor};

    /// Draws from AIPs that predict the marginals of a dataset in which class 1 came in a quarter of the samples.
    fn share_of_ones(sources: SourceSpec) -> f64 {
        let spec = RegionSpec { obs_dim: 2, d_set_dim: 2, n_actions: 2, sources, horizon: 1000 };
        let mut dataset = Dataset::new(&spec);
        (0..1000).for_each(|sample| dataset.push(&[1.0, 0.0], &[u8::from(sample % 4 == 0)]));
        let config = AipConfig { hidden: vec![5], ..AipConfig::default() };
        let mut aips = AipStack::new(&[AgentId(0)], &spec, &config, Seed::new(3));
        let mut parameters = aips.values();
        predict_marginals(&mut parameters, &AipStack::shape(&spec, &config).layout(), sources, &[dataset]);
        aips.load(&parameters);
        let rows = 20_000;
        let mut dice: Vec<Dice> = (0..rows).map(|copy| Seed::new(9).for_copy(copy).dice()).collect();
        let mut drawn = Rows::new(rows, 1);
        aips.begin(rows);
        aips.sample(&Rows::new(rows, 2), &mut dice, &mut drawn);
        drawn.iter().filter(|row| row[0] == 1).count() as f64 / rows as f64
    }

    #[test]
    fn sources_come_as_often_as_in_the_dataset() {
        // Standard error: sqrt(0.1875 / 20000) = 0.003.
        for sources in [SourceSpec::Binary { sources: 1 }, SourceSpec::Categorical { sources: 1, classes: 3 }] {
            let share = share_of_ones(sources);
            assert!((share - 0.25).abs() < 0.012, "{share}");
        }
    }
}
