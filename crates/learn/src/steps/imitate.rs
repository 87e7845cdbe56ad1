//! The imitation of a controller, before the training: episodes on the GS in which it decides, and what policies learn
//! from them.

use std::ops::Range;
use std::time::Instant;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step};
use crate::algorithms::imitation::{ImitationLoss, demonstrate};
use crate::fleet::{Fleet, Stop, of_owners};
use crate::observer::Observer;
use crate::policy::{Demonstrations, JointPolicy};
use crate::worker::Worker;
use crate::worker::block::AgentBlock;
use crate::worker::watched::Watched;
use dials_core::base::{Activity, Phase, RandomPurpose, Seed, Stopwatch};
use dials_core::domain::{Baseline, Result};

#[derive(Debug, Serialize, Deserialize)]
pub struct Imitate {
    pub(crate) demonstrations: Vec<Demonstrations>,
}

impl Step for Imitate {
    type Reply = (Vec<ImitationLoss>, JointPolicy);

    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<(Vec<ImitationLoss>, JointPolicy)> {
        let losses = worker.in_blocks(Activity::Training, self.demonstrations, observer, AgentBlock::imitate);
        Ok((losses, worker.policies()))
    }

    fn check(&self) -> Check<(Vec<ImitationLoss>, JointPolicy)> {
        Box::new(|(losses, policies), fit| {
            ensure!(losses.len() == fit.agents.len(), "{} of its agents have imitated", losses.len());
            fit.check_policies(policies)
        })
    }
}

/// Makes every agent's policy imitate its demonstrations, and returns how well it does.
pub fn imitate(fleet: &mut impl Fleet, mut demonstrations: Vec<Demonstrations>) -> Result<Vec<ImitationLoss>> {
    let step = |agents| Imitate { demonstrations: of_owners(&mut demonstrations, &agents) };
    let parts = fleet.ask_owners(Activity::Training, Stop::AtOnce, step, |state, agents, (losses, policies)| {
        state.policies.replace(agents.start, &policies);
        losses
    })?;
    Ok(parts.concat())
}

#[derive(Debug, Serialize, Deserialize)]
pub struct Demonstrate {
    pub(crate) controller: String,
    pub(crate) episodes: Range<usize>,
}

impl Step for Demonstrate {
    /// Demonstrations of *all* agents, in the order of the episodes.
    type Reply = Vec<Demonstrations>;

    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<Vec<Demonstrations>> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let (config, domain) = (&worker.config, &worker.domain);
        let seed = Seed::new(config.seed).fork(RandomPurpose::Demonstrations);
        let mut demonstrations = Demonstrations::of_all(domain.kinds());
        let Baseline { mut simulator, mut controller } =
            watch.time(Phase::Loading, || domain.baseline(&self.controller))?;
        let decisions = self.episodes.len() * domain.kinds().horizon();
        let mut controller = Watched::new(&mut *controller, observer, Activity::Collection, decisions);
        for episode in self.episodes {
            let seed = seed.for_episode(episode);
            demonstrate(&mut *simulator, &mut controller, seed, config.imitation.slips, &mut demonstrations)?;
        }
        controller.add_to(&mut watch, &mut *simulator);
        drop(simulator);
        // They train policies. What is collected for AIPs is counted apart.
        worker.note(Activity::Training, begun.elapsed(), &watch);
        Ok(demonstrations)
    }

    /// Checks the demonstrations of all agents, not only those of the worker.
    fn check(&self) -> Check<Vec<Demonstrations>> {
        let episodes = self.episodes.len();
        Box::new(move |demonstrations, fit| {
            let agents = fit.kinds.agents();
            ensure!(demonstrations.len() == agents, "it made demonstrations of {} agents", demonstrations.len());
            for (agent, (made, spec)) in demonstrations.iter().zip(fit.kinds.specs()).enumerate() {
                let samples = episodes * spec.horizon;
                ensure!(
                    made.fits(spec, samples),
                    "the demonstrations of agent {agent} do not have {samples} samples of its region"
                );
            }
            Ok(())
        })
    }
}

/// Lets a controller play on the GS. Returns what every agent saw and did.
pub fn collect_demonstrations(fleet: &mut impl Fleet, controller: &str) -> Result<Vec<Demonstrations>> {
    let episodes = fleet.config().imitation.episodes(fleet.domain().kinds().horizon());
    let step = |episodes| Demonstrate { controller: controller.to_owned(), episodes };
    let made = fleet.ask_all(Activity::Collection, episodes, false, step)?;
    let mut all = Demonstrations::of_all(fleet.domain().kinds());
    for parts in made {
        all.iter_mut().zip(&parts).for_each(|(whole, part)| whole.extend(part));
    }
    Ok(all)
}
