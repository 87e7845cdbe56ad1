//! Evaluation of the joint policy on the GS.

use std::ops::Range;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step};
use crate::evaluation::{EpisodeReport, Evaluation, episode_seed, play};
use crate::fleet::Fleet;
use crate::observer::Observer;
use crate::worker::Worker;
use dials_core::base::{Activity, Seed};
use dials_core::domain::{Measures, Result};

#[derive(Debug, Serialize, Deserialize)]
pub struct Evaluate {
    pub episodes: Range<usize>,
}

impl Step for Evaluate {
    type Reply = Vec<EpisodeReport>;

    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<Vec<EpisodeReport>> {
        let seed = Seed::new(worker.config.evaluation.seed);
        let mut reports = Vec::with_capacity(self.episodes.len());
        worker.on_the_gs(Activity::Evaluation, self.episodes, observer, |simulator, controller, episode| {
            reports.push(play(simulator, controller, episode_seed(seed, episode))?);
            Ok(())
        })?;
        Ok(reports)
    }

    fn check(&self) -> Check<Vec<EpisodeReport>> {
        let episodes = self.episodes.len();
        Box::new(move |reports, fit| {
            ensure!(reports.len() == episodes, "it played {} episodes, not {episodes}", reports.len());
            let agents = fit.kinds.agents();
            for EpisodeReport { returns, measures } in reports {
                ensure!(
                    returns.len() == agents && measures.per_agent.iter().all(|(_, values)| values.len() == agents),
                    "its episodes are not of {agents} agents"
                );
                ensure!(returns.iter().all(|value| value.is_finite()), "a return is not a finite number");
                ensure!(same_names(&reports[0], measures), "its episodes have different measures");
            }
            Ok(())
        })
    }
}

/// Evaluates the joint policy on the first `episodes` evaluation episodes.
pub fn evaluate(fleet: &mut impl Fleet, episodes: usize) -> Result<Evaluation> {
    let parts = fleet.ask_all(Activity::Evaluation, episodes, true, |episodes| Evaluate { episodes })?;
    let reports = parts.concat();
    let alike = reports.iter().all(|report| same_names(&reports[0], &report.measures));
    ensure!(alike, "the workers played episodes with different measures");
    Ok(Evaluation::new(fleet.domain(), &reports))
}

/// Returns whether an episode has the measures of another one.
fn same_names(first: &EpisodeReport, other: &Measures) -> bool {
    let Measures { per_agent, system } = &first.measures;
    per_agent.iter().map(|(name, _)| name).eq(other.per_agent.iter().map(|(name, _)| name))
        && system.iter().map(|(name, _)| name).eq(other.system.iter().map(|(name, _)| name))
}
