//! The loss of the influence predictors on new episodes of the GS (global simulator), from which they do not learn.

use serde::{Deserialize, Serialize};

use super::parts::PartFrequencies;
use super::{CrossEntropies, Dataset, TrainablePredictor, mean_loss};
use dials_core::base::Stopwatch;

/// Loss of one agent's predictor on new episodes, for each source that the agent has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FreshLoss {
    pub predictor: CrossEntropies,
    /// Loss of the best constants for these very episodes, and for each of their parts: no constant predictor is better.
    pub marginals: CrossEntropies,
}

impl FreshLoss {
    /// Returns means over the sources: of the predictor and of the constants.
    pub fn means(&self) -> [f64; 2] {
        [mean_loss(&self.predictor), mean_loss(&self.marginals)]
    }

    /// Returns the same means over all agents.
    pub fn means_of_all(losses: &[FreshLoss]) -> [f64; 2] {
        [0, 1].map(|which| losses.iter().map(|loss| loss.means()[which]).sum::<f64>() / losses.len() as f64)
    }
}

/// Measures every agent's predictor on its own dataset. All datasets have the same length.
pub fn measure(predictor: &dyn TrainablePredictor, datasets: &[Dataset], watch: &mut Stopwatch) -> Vec<FreshLoss> {
    let losses = predictor.cross_entropies(datasets, 0..datasets[0].len(), watch);
    let per_agent = losses.into_iter().zip(datasets).map(|(predictor_loss, dataset)| {
        let seen = PartFrequencies::of(predictor.sources(), dataset, 0..dataset.len());
        FreshLoss { predictor: dataset.only_own(predictor_loss), marginals: dataset.only_own(seen.entropies()) }
    });
    per_agent.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predictors::Marginals;
    use dials_core::domain::{Kinds, RegionSpec, SourceSpec};

    #[test]
    fn losses_on_fresh_episodes_are_worked_out_by_hand() {
        let sources = SourceSpec::bits(2);
        let spec =
            RegionSpec { obs_dim: 1, d_set_dim: 1, n_actions: 2, masks: false, sources, horizon: 4, local_horizon: 4 };
        let mut dataset = Dataset::new(&spec);
        (0..8).for_each(|t| dataset.push(&[0.0], &[u8::from(t % 4 == 0), 1]));
        // Constants of 1/2 lose ln 2 on everything; the best ones lose H(1/4) = 0.562335, and nothing on a sure source.
        let loss = measure(&Marginals::new(1, &spec), &[dataset], &mut Stopwatch::default()).remove(0);
        assert!(loss.predictor.iter().all(|loss| (loss - 2_f64.ln()).abs() < 1e-7));
        assert!((loss.marginals[0] - 0.562_335).abs() < 1e-6 && loss.marginals[1] == 0.0, "{loss:?}");
        let means = loss.means();
        assert!((means[0] - 2_f64.ln()).abs() < 1e-7 && (means[1] - 0.281_168).abs() < 1e-6);
    }

    #[test]
    fn sources_that_an_agent_does_not_have_do_not_count() {
        let sources = SourceSpec::bits(3);
        let spec =
            RegionSpec { obs_dim: 1, d_set_dim: 1, n_actions: 2, masks: false, sources, horizon: 4, local_horizon: 4 };
        let kinds = Kinds::one(3, spec.clone()).with_sources(vec![3, 1, 0]);
        let mut datasets = Dataset::of_all(&kinds);
        for t in 0..8 {
            datasets[0].push(&[0.0], &[t % 2, t % 2, t % 2]);
            datasets[1].push(&[0.0], &[t % 2, 0, 0]);
            datasets[2].push(&[0.0], &[0, 0, 0]);
        }
        let losses = measure(&Marginals::new(3, &spec), &datasets, &mut Stopwatch::default());
        assert_eq!([0, 1, 2].map(|agent| losses[agent].predictor.len()), [3, 1, 0]);
        let constants = losses.iter().map(|loss| loss.means()[1]);
        // Fair coins. The second agent loses as much per source as the first, the third has nothing to lose.
        assert!(constants.zip([2_f64.ln(), 2_f64.ln(), 0.0]).all(|(loss, expected)| (loss - expected).abs() < 1e-7));
        assert!((FreshLoss::means_of_all(&losses)[1] - 2_f64.ln() * 2.0 / 3.0).abs() < 1e-7);
    }
}
