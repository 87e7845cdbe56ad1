//! The loss of the AIPs on datasets that they were not trained on.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step};
use crate::fleet::{Fleet, Stop, of_owners};
use crate::observer::Observer;
use crate::predictors::{Dataset, FreshLoss};
use crate::state::fits::Fit;
use crate::steps::collect::Purpose;
use crate::worker::Worker;
use dials_core::base::{Activity, AgentId};
use dials_core::domain::Result;

#[derive(Debug, Serialize, Deserialize)]
pub struct MeasureAips {
    pub datasets: Vec<Dataset>,
}

impl Step for MeasureAips {
    type Reply = Vec<FreshLoss>;

    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<Vec<FreshLoss>> {
        let activity = Purpose::Measuring.activity(&worker.config);
        Ok(worker.in_blocks(activity, self.datasets, observer, |block, datasets, work| {
            block.measure_aips(datasets, work.watch)
        }))
    }

    fn check(&self) -> Check<Vec<FreshLoss>> {
        Box::new(|losses, fit| {
            check_losses(fit, losses.iter().map(|loss| vec![loss.predictor.len(), loss.marginals.len()]))
        })
    }
}

/// Checks the numbers of losses of every agent: one per influence source that it has.
pub(super) fn check_losses(fit: &Fit<'_>, losses: impl ExactSizeIterator<Item = Vec<usize>>) -> Result<()> {
    ensure!(losses.len() == fit.agents.len(), "it measured the AIPs of {} agents", losses.len());
    let fits = |(agent, lengths): (usize, Vec<usize>)| {
        let own = fit.kinds.sources(AgentId(agent));
        lengths.into_iter().all(|count| count == own)
    };
    ensure!(fit.agents.clone().zip(losses).all(fits), "it measured other influence sources than its agents have");
    Ok(())
}

/// Measures the loss of every agent's predictor on its dataset.
pub(crate) fn measure_aips(fleet: &mut impl Fleet, mut datasets: Vec<Dataset>) -> Result<Vec<FreshLoss>> {
    let step = |agents| MeasureAips { datasets: of_owners(&mut datasets, &agents) };
    let parts = fleet.ask_owners(Activity::Evaluation, Stop::AtOnce, step, |_, _, losses| losses)?;
    Ok(parts.concat())
}
