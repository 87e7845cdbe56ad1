//! The imitation of a controller, before the training.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step};
use crate::algorithms::imitation::ImitationLoss;
use crate::fleet::{Fleet, Stop, of_owners};
use crate::observer::Observer;
use crate::policy::{Demonstrations, JointPolicy};
use crate::worker::Worker;
use crate::worker::block::AgentBlock;
use dials_core::base::Activity;
use dials_core::domain::Result;

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
