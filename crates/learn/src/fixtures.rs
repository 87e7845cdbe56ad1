//! What several unit tests need.

use crate::config::AipConfig;
use crate::predictors::{AipLoss, Dataset, TrainablePredictor, train};
use dials_core::base::{AgentId, Dice, Seed, Stopwatch, Work};
use dials_core::domain::{RegionSpec, SourceSpec};
use stacknets::Threads;

/// Returns a region of two actions.
pub(crate) fn region(obs_dim: usize, d_set_dim: usize, sources: SourceSpec, horizon: usize) -> RegionSpec {
    RegionSpec { obs_dim, d_set_dim, n_actions: 2, sets: None, masks: false, sources, horizon, local_horizon: horizon }
}

/// Returns the dice of this number of rows.
pub(crate) fn dice(rows: usize) -> Vec<Dice> {
    (0..rows).map(|row| Seed::new(9).for_copy(row).dice()).collect()
}

/// Trains the predictors of the agents 0, 1, ... on their datasets.
pub(crate) fn trained(aips: &mut dyn TrainablePredictor, datasets: &[Dataset], config: &AipConfig) -> Vec<AipLoss> {
    let work = Work { watch: &mut Stopwatch::default(), progress: &mut |_| () };
    train(aips, &AgentId::all(datasets.len()), datasets, (config, &Threads::one()), Seed::new(2), work)
}

/// Asserts that a gradient agrees with finite differences of a function, up to an error of 1e-3.
pub(crate) fn assert_gradient(of: impl Fn(&[f32]) -> f64, at: &[f32], gradient: &[f32], step: f32) {
    for (i, &slope) in gradient.iter().enumerate() {
        let shifted = |by: f32| {
            let mut at = at.to_vec();
            at[i] += by;
            of(&at)
        };
        let measured = (shifted(step) - shifted(-step)) / f64::from(2.0 * step);
        assert!((measured - f64::from(slope)).abs() < 1e-3, "number {i}: {measured} {slope}");
    }
}
