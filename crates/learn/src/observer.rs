//! Observers of a run, which may also ask it to stop.

use crate::algorithms::imitation::ImitationLoss;
use crate::evaluation::Evaluation;
use crate::predictors::{AipLoss, FreshLoss};
use crate::training::drift::Drift;
use dials_core::base::Activity;

/// An observer of the progress.
pub trait Observer {
    /// The policies have been trained for N timesteps per agent.
    fn trained(&self, _steps: u64) {}

    /// Another activity is going on, and this share of it (`0..=1`) is done.
    fn busy(&self, _activity: Activity, _share: f64) {}

    /// The policies have imitated a controller.
    fn imitated(&self, _controller: &str, _losses: &[ImitationLoss]) {}

    fn evaluated(&self, _steps: u64, _evaluation: &Evaluation) {}

    fn aips_trained(&self, _steps: u64, _losses: &[AipLoss]) {}

    /// The loss of the AIPs was measured on new episodes; the drift compares it with that after their last training.
    fn aips_measured(&self, _losses: &[FreshLoss], _drift: &Drift) {}

    /// A worker was lost and started again.
    fn worker_lost(&self, _message: &str) {}

    /// Returns whether the run was asked to stop at the next point at which nothing is lost.
    fn stop_requested(&self) -> bool {
        false
    }

    /// Returns whether anything can be lost. A benchmark throws its results away, so it may stop anywhere.
    fn keeps_results(&self) -> bool {
        true
    }
}

/// An observer that ignores everything.
pub struct Silent;

impl Observer for Silent {}

/// The run was stopped on request; it can be resumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Interrupted;
