//! The training of the AIPs, each on the dataset of its agent.

use serde::{Deserialize, Serialize};

use super::measure_aips::check_losses;
use super::{Check, Step};
use crate::config::Period;
use crate::fleet::{Fleet, Stop, of_owners};
use crate::observer::Observer;
use crate::predictors::{AipLoss, Dataset};
use crate::worker::Worker;
use dials_core::base::{Activity, Ragged};
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
    let step = |agents| TrainAips { datasets: of_owners(&mut datasets, &agents), period: *period };
    let parts = fleet.ask_owners(Activity::AipTraining, Stop::AtOnce, step, |state, agents, (losses, aips)| {
        state.aips.replace(agents.start, &aips);
        losses
    })?;
    Ok(parts.concat())
}
