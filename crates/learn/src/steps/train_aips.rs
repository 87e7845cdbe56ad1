//! The training of the AIPs, each on the dataset of its agent, and the measurement of their loss.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::collect::Purpose;
use super::{Check, Step};
use crate::config::Period;
use crate::fleet::{Fleet, Stop, of_owners};
use crate::observer::Observer;
use crate::predictors::{AipLoss, Dataset, FreshLoss, outside};
use crate::state::fits::Fit;
use crate::worker::Worker;
use dials_core::base::{Activity, AgentId, Ragged};
use dials_core::domain::Result;

#[derive(Debug, Serialize, Deserialize)]
pub struct TrainAips {
    pub datasets: Vec<Dataset>,
    pub period: Period,
}

impl Step for TrainAips {
    /// Losses, and what the predictors have learnt, one row each.
    type Reply = (Vec<AipLoss>, Ragged<f32>);

    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<(Vec<AipLoss>, Ragged<f32>)> {
        let losses = worker.in_blocks(Activity::AipTraining, self.datasets, observer, |block, datasets, work| {
            block.train_aips(datasets, &self.period, work)
        });
        Ok((losses, worker.aips()))
    }

    fn check(&self) -> Check<(Vec<AipLoss>, Ragged<f32>)> {
        Box::new(|(losses, aips), fit| {
            check_losses(
                fit,
                losses.iter().map(|loss| {
                    let lengths = loss.training.iter().chain(&loss.held_out).chain([&loss.marginals]).map(Vec::len);
                    lengths.chain([loss.frequencies.len()]).collect()
                }),
            )?;
            fit.check_aips(aips)
        })
    }
}

/// Trains every agent's predictor on its dataset and returns the losses.
pub fn train_aips(fleet: &mut impl Fleet, mut datasets: Vec<Dataset>, period: &Period) -> Result<Vec<AipLoss>> {
    if fleet.config().predicts_outside() {
        let (losses, state) = outside::train(fleet.domain().kinds(), &datasets, &fleet.config().aip)?;
        fleet.keep_outside_aips(state);
        return Ok(losses);
    }
    let step = |agents| TrainAips { datasets: of_owners(&mut datasets, &agents), period: *period };
    let parts = fleet.ask_owners(Activity::AipTraining, Stop::AtOnce, step, |state, agents, (losses, aips)| {
        state.aips.replace(agents.start, &aips);
        losses
    })?;
    Ok(parts.concat())
}

/// The measurement of the loss on datasets from which nothing is learnt.
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
fn check_losses(fit: &Fit<'_>, losses: impl ExactSizeIterator<Item = Vec<usize>>) -> Result<()> {
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
    if fleet.config().predicts_outside() {
        return outside::measure(fleet.domain().kinds(), &datasets);
    }
    let step = |agents| MeasureAips { datasets: of_owners(&mut datasets, &agents) };
    let parts = fleet.ask_owners(Activity::Evaluation, Stop::AtOnce, step, |_, _, losses| losses)?;
    Ok(parts.concat())
}
