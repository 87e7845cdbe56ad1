//! Who watches a run: observers, which may also ask it to stop, and recorders, which may write files.

use crate::algorithms::imitation::ImitationLoss;
use crate::evaluation::Evaluation;
use crate::fleet::FleetLoad;
use crate::predictors::{AipLoss, FreshLoss};
use crate::progress::{Drift, Moment, TrainingProgress};
use crate::state::AgentsState;
use crate::steps::train_policies::PolicyTraining;
use dials_core::base::Activity;
use dials_core::domain::Result;

pub trait Observer {
    /// The policies have been trained for N timesteps per agent.
    fn trained(&self, _steps: u64) {}

    /// Another activity is going on, and this share of it (`0..=1`) is done.
    fn busy(&self, _activity: Activity, _share: f64) {}

    fn imitated(&self, _controller: &str, _losses: &[ImitationLoss]) {}

    fn evaluated(&self, _steps: u64, _evaluation: &Evaluation) {}

    fn aips_trained(&self, _steps: u64, _losses: &[AipLoss]) {}

    /// The loss of the AIPs was measured on new episodes; the drift compares it with that after their last training.
    fn aips_measured(&self, _losses: &[FreshLoss], _drift: &Drift) {}

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

pub struct Silent;

impl Observer for Silent {}

/// The run was stopped on request; it can be resumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Interrupted;

/// A record of what happened. It returns no information: how training continues is in [`TrainingProgress`]. An error
/// ends the training.
///
/// `agents`: all agents, as they are after the event.
pub trait Recorder {
    /// Training begins, or continues, with these agents.
    fn begun(&mut self, _agents: &AgentsState) -> Result<()> {
        Ok(())
    }

    fn imitated(&mut self, _agents: &AgentsState, _losses: &[ImitationLoss]) -> Result<()> {
        Ok(())
    }

    fn evaluated(&mut self, _agents: &AgentsState, _evaluation: &Evaluation) -> Result<()> {
        Ok(())
    }

    fn aips_trained(&mut self, _agents: &AgentsState, _losses: &[AipLoss]) -> Result<()> {
        Ok(())
    }

    /// The loss of the AIPs was measured on new episodes.
    fn aips_measured(&mut self, _agents: &AgentsState, _after: Moment, _losses: &[FreshLoss]) -> Result<()> {
        Ok(())
    }

    /// A period of training is over. Training can continue from here with `agents` and `progress`.
    fn period_done(
        &mut self,
        _agents: &AgentsState,
        _progress: &TrainingProgress,
        _training: &PolicyTraining,
        _load: FleetLoad,
    ) -> Result<()> {
        Ok(())
    }

    /// Training can continue from here, between two periods or within one.
    fn saved(&mut self, _agents: &AgentsState, _progress: &TrainingProgress) -> Result<()> {
        Ok(())
    }

    /// The last evaluation is over.
    fn finished(&mut self, _agents: &AgentsState, _load: FleetLoad) -> Result<()> {
        Ok(())
    }
}

pub struct Unrecorded;

impl Recorder for Unrecorded {}
