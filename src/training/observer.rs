//! Who watches a run, and may ask it to stop.

use super::drift::Drift;
use crate::base::Activity;
use crate::evaluation::Evaluation;
use crate::influence::{AipLoss, FreshLoss};

/// Hears of the work as it goes on.
pub trait Observer {
    /// The policies have been trained for so many timesteps per agent.
    fn trained(&self, _steps: u64) {}

    /// Something else is going on, and this share of it (`0..=1`) is done.
    fn busy(&self, _activity: Activity, _share: f64) {}

    fn evaluated(&self, _steps: u64, _evaluation: &Evaluation) {}

    fn aips_trained(&self, _steps: u64, _losses: &[AipLoss]) {}

    /// The AIPs' loss on fresh episodes, and how it stands to that right after their last training.
    fn aips_measured(&self, _losses: &[FreshLoss], _drift: &Drift) {}

    /// A worker was lost and started again.
    fn worker_lost(&self, _message: &str) {}

    /// Somebody asked the run to stop at the next place where nothing is lost.
    fn stop_requested(&self) -> bool {
        false
    }

    /// Whether anything can be lost: a benchmark throws its results away and may stop anywhere.
    fn keeps_results(&self) -> bool {
        true
    }
}

/// Hears nothing.
pub struct Silent;

impl Observer for Silent {}

/// The run stopped because somebody asked for it; it can be resumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Interrupted;
