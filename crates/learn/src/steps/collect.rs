//! Algorithm 2: datasets for the influence predictors, from episodes on the GS.

use std::ops::Range;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step};
use crate::config::{Config, Retrain};
use crate::fleet::Fleet;
use crate::observer::Observer;
use crate::predictors::Dataset;
use crate::worker::Worker;
use dials_core::base::{Activity, AgentId, RandomPurpose, Seed};
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
            Purpose::Training { steps: 0 } => config.first_dataset_episodes(horizon),
            Purpose::Training { .. } => config.dataset_episodes(horizon),
            Purpose::Measuring => config.evaluation.aip_loss_episodes,
        }
    }

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

#[derive(Debug, Serialize, Deserialize)]
pub struct Collect {
    pub purpose: Purpose,
    pub episodes: Range<usize>,
}

impl Step for Collect {
    /// Datasets of *all* agents, in the order of the episodes.
    type Reply = Vec<Dataset>;

    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<Vec<Dataset>> {
        let seed = self.purpose.stream(&worker.config);
        let mut datasets = Dataset::of_all(worker.domain.kinds());
        let activity = self.purpose.activity(&worker.config);
        worker.on_the_gs(activity, self.episodes, observer, |simulator, controller, episode| {
            collect_episode(simulator, controller, seed.for_episode(episode), &mut datasets)
        })?;
        Ok(datasets)
    }

    /// Checks the datasets of all agents, not only those of the worker.
    fn check(&self) -> Check<Vec<Dataset>> {
        let episodes = self.episodes.len();
        Box::new(move |datasets, fit| {
            let agents = fit.kinds.agents();
            ensure!(datasets.len() == agents, "it made {} datasets, not {agents}", datasets.len());
            for (agent, (dataset, spec)) in datasets.iter().zip(fit.kinds.specs()).enumerate() {
                let Dataset { d_sets, sources, horizon, own_sources } = dataset;
                let samples = episodes * spec.horizon;
                let shapes = (d_sets.width(), sources.width(), *horizon, *own_sources);
                let own = fit.kinds.sources(AgentId(agent));
                ensure!(
                    shapes == (spec.d_set_dim, spec.sources.count(), spec.horizon, own)
                        && d_sets.len() == samples
                        && sources.len() == samples,
                    "the dataset of agent {agent} does not have {samples} samples of its region"
                );
                let known = |row: &[u8]| row.iter().zip(&spec.sources.classes).all(|(class, classes)| class < classes);
                ensure!(sources.iter().all(known), "the dataset of agent {agent} has unknown influence sources");
            }
            Ok(())
        })
    }
}

/// Runs Algorithm 2: one dataset per agent, under the joint policy.
pub fn collect_datasets(fleet: &mut impl Fleet, purpose: Purpose) -> Result<Vec<Dataset>> {
    let (activity, episodes) = {
        let config = fleet.config();
        (purpose.activity(config), purpose.episodes(config, fleet.domain().kinds().horizon()))
    };
    let collected = fleet.ask_all(activity, episodes, true, |episodes| Collect { purpose, episodes })?;
    let mut datasets = Dataset::of_all(fleet.domain().kinds());
    for parts in collected {
        datasets.iter_mut().zip(&parts).for_each(|(dataset, part)| dataset.extend(part));
    }
    Ok(datasets)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_dataset_has_its_share_of_the_episodes() {
        let mut config = Config::default();
        config.aip.first_dataset_share = 0.4;
        let purposes = [Purpose::Training { steps: 0 }, Purpose::Training { steps: 1 }, Purpose::Measuring];
        let episodes = purposes.map(|purpose| purpose.episodes(&config, 300));
        assert_eq!(episodes, [14, 34, config.evaluation.aip_loss_episodes]); // of 10 000 steps, and of 4000 of them
    }

    #[test]
    fn every_purpose_has_episodes_of_its_own() {
        let mut config = Config::default();
        config.seed = config.evaluation.seed; // as close as the two seeds can be
        let purposes = [Purpose::Measuring, Purpose::Training { steps: 0 }, Purpose::Training { steps: 1 }];
        let mut streams = purposes.map(|purpose| purpose.stream(&config).for_episode(0)).to_vec();
        streams.push(crate::evaluation::episode_seed(Seed::new(config.evaluation.seed), 0));
        assert!((0..4).all(|i| (0..i).all(|j| streams[i] != streams[j])));
    }
}
