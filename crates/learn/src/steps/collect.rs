//! Algorithm 2: datasets for the influence predictors, from episodes on the global simulator (GS).

use std::ops::Range;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step, on_its_way};
use crate::fleet::Fleet;
use crate::observer::Observer;
use crate::predictors::Dataset;
use crate::training::collect::{Purpose, collect_episode};
use crate::worker::Worker;
use dials_core::base::AgentId;
use dials_core::domain::Result;

/// Asks for the datasets of all agents from these episodes.
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

    on_its_way!(Collect);
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
