//! The loss of the influence predictors (AIPs) on datasets that they were not trained on.

use std::time::Instant;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step, on_its_way};
use crate::fleet::{Fleet, Stop, of_owners};
use crate::observer::Observer;
use crate::predictors::{Dataset, FreshLoss};
use crate::state::fits::Fit;
use crate::steps::collect::Purpose;
use crate::worker::Worker;
use dials_core::base::{Activity, AgentId, Stopwatch};
use dials_core::domain::Result;

/// Asks a worker to measure the loss of the predictors of its agents on their datasets.
#[derive(Debug, Serialize, Deserialize)]
pub struct MeasureAips {
    pub datasets: Vec<Dataset>,
}

impl Step for MeasureAips {
    type Reply = Vec<FreshLoss>;

    fn run(self, worker: &mut Worker, _observer: &dyn Observer) -> Result<Vec<FreshLoss>> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let mut losses = Vec::new();
        let datasets = worker.by_block(self.datasets);
        for (block, datasets) in worker.blocks.iter().zip(&datasets) {
            losses.extend(block.measure_aips(datasets, &mut watch));
        }
        worker.note(Purpose::Measuring.activity(&worker.config), begun.elapsed(), &watch);
        Ok(worker.in_order(losses))
    }

    fn check(&self) -> Check<Vec<FreshLoss>> {
        Box::new(|losses, fit| {
            check_losses(fit, losses.iter().map(|loss| vec![loss.predictor.len(), loss.marginals.len()]))
        })
    }

    on_its_way!(MeasureAips);
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
