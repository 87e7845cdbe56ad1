//! What Algorithm 1 reports as it proceeds. The listener may write files; training does not know.

use crate::algorithms::imitation::ImitationLoss;
use crate::evaluation::Evaluation;
use crate::predictors::{AipLoss, FreshLoss};
use crate::progress::Standing;
use crate::state::AgentsState;
use crate::training::answers::{FleetLoad, PolicyTraining};
use crate::training::drift::Moment;
use dials_core::domain::Result;

/// A record of what happened. It returns no information: how training continues is in [`Standing`]. An error ends the
/// training.
///
/// `agents`: all agents, as they are after the event.
pub trait Journal {
    /// Training begins, or continues, with these agents.
    fn begun(&mut self, _agents: &AgentsState) -> Result<()> {
        Ok(())
    }

    /// The policies have imitated a controller.
    fn imitated(&mut self, _agents: &AgentsState, _losses: &[ImitationLoss]) -> Result<()> {
        Ok(())
    }

    /// The joint policy was evaluated.
    fn evaluated(&mut self, _agents: &AgentsState, _evaluation: &Evaluation) -> Result<()> {
        Ok(())
    }

    /// The AIPs were trained.
    fn aips_trained(&mut self, _agents: &AgentsState, _losses: &[AipLoss]) -> Result<()> {
        Ok(())
    }

    /// The loss of the AIPs was measured on new episodes.
    fn aips_measured(&mut self, _agents: &AgentsState, _after: Moment, _losses: &[FreshLoss]) -> Result<()> {
        Ok(())
    }

    /// A period of training is over. Training can continue from here with `agents` and `standing`.
    fn period_done(
        &mut self,
        _agents: &AgentsState,
        _standing: &Standing,
        _training: &PolicyTraining,
        _load: FleetLoad,
    ) -> Result<()> {
        Ok(())
    }

    /// The last evaluation is over.
    fn finished(&mut self, _agents: &AgentsState, _load: FleetLoad) -> Result<()> {
        Ok(())
    }
}

/// A journal that records nothing.
pub struct Unrecorded;

impl Journal for Unrecorded {}
