//! Algorithm 2: datasets for the approximate influence predictors (AIPs), from the global simulator (GS) under the
//! joint policy.

use serde::{Deserialize, Serialize};

use crate::config::{Config, Retrain};
use crate::predictors::Dataset;
use dials_core::base::{Activity, RandomPurpose, Seed};
use dials_core::domain::{Controller, GlobalSimulator, Result};

/// Purpose of a dataset. Each purpose has its own stream of episodes, which no evaluation plays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Purpose {
    /// Training of the AIPs, at this number of timesteps per agent.
    Training { steps: u64 },
    /// Measuring the loss of the AIPs: the same episodes every time, so that only the policies and the AIPs change.
    Measuring,
}

impl Purpose {
    pub fn episodes(self, config: &Config, horizon: usize) -> usize {
        match self {
            Purpose::Training { .. } => config.dataset_episodes(horizon),
            Purpose::Measuring => config.evaluation.aip_loss_episodes,
        }
    }

    /// Returns the stream of the episodes.
    pub(crate) fn stream(self, config: &Config) -> Seed {
        match self {
            Purpose::Training { steps } => Seed::new(config.seed).fork(RandomPurpose::Collection).for_steps(steps),
            Purpose::Measuring => Seed::new(config.evaluation.seed).fork(RandomPurpose::AipLoss),
        }
    }

    /// Returns the activity that the time is booked on. If AIPs are retrained on drift, measuring their loss is part of
    /// the training.
    pub(crate) fn activity(self, config: &Config) -> Activity {
        match self {
            Purpose::Measuring if config.aip.retrain != Retrain::Drift => Activity::Evaluation,
            Purpose::Training { .. } | Purpose::Measuring => Activity::Collection,
        }
    }
}

/// Plays one episode and appends every agent's pairs `(l_t, u_t)` to its dataset.
pub fn collect_episode(
    simulator: &mut dyn GlobalSimulator,
    policies: &mut dyn Controller,
    episode: Seed,
    datasets: &mut [Dataset],
) -> Result<()> {
    let horizon = simulator.kinds().horizon();
    let mut actions = vec![0; simulator.agents()];
    policies.begin(episode);
    simulator.observe_influence()?;
    let mut percept = simulator.reset(episode)?.clone();
    for _ in 0..horizon {
        policies.act(&percept, &mut actions)?;
        percept.clone_from(&simulator.step(&actions)?.percept);
        let sample = simulator.influence_sample();
        for (agent, dataset) in datasets.iter_mut().enumerate() {
            dataset.push(sample.d_set.row(agent), sample.sources.row(agent));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::domain::Domain;
    use dials_testkit::toy::Coins;

    #[test]
    fn every_purpose_has_episodes_of_its_own() {
        let mut config = Config::default();
        config.seed = config.evaluation.seed; // as close as the two seeds can be
        let purposes = [Purpose::Measuring, Purpose::Training { steps: 0 }, Purpose::Training { steps: 1 }];
        let mut streams = purposes.map(|purpose| purpose.stream(&config).for_episode(0)).to_vec();
        streams.push(crate::evaluation::episode_seed(Seed::new(config.evaluation.seed), 0));
        assert!((0..4).all(|i| (0..i).all(|j| streams[i] != streams[j])));
    }

    #[test]
    fn a_dataset_holds_the_closed_form_influence_of_copying_coins() {
        let coins = Coins::new(500);
        let mut baseline = coins.baseline("copy").unwrap();
        let mut datasets = Dataset::of_all(coins.kinds());
        for episode in 0..20 {
            let seed = Seed::new(8).for_episode(episode);
            collect_episode(&mut *baseline.simulator, &mut *baseline.controller, seed, &mut datasets).unwrap();
        }
        // P(u = x) = 0.8^2 + 0.2^2 = 0.68; 10000 samples: standard error sqrt(0.68 * 0.32 / 10000) = 0.0047.
        for dataset in datasets {
            assert_eq!((dataset.len(), dataset.episodes()), (10_000, 20));
            let mut d_set = [0.0; 2];
            let mut is_equal = |sample: usize| {
                dataset.d_sets.read(sample, &mut d_set);
                d_set[0] == f32::from(dataset.sources.row(sample)[0])
            };
            let equal = (0..dataset.len()).filter(|&sample| is_equal(sample)).count();
            assert!((equal as f64 / 10_000.0 - 0.68).abs() < 0.019, "{equal}");
        }
    }
}
