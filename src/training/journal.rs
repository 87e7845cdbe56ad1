//! What Algorithm 1 reports as it goes. Who listens may write files; training does not know.

use super::answers::{FleetLoad, PolicyTraining};
use super::drift::Moment;
use super::standing::Standing;
use super::state::AgentsState;
use crate::domain::Result;
use crate::evaluation::Evaluation;
use crate::influence::{AipLoss, FreshLoss};

/// Writes down what happened. It answers no question: how training goes on is in [`Standing`]. An error ends training.
///
/// `agents`: all of them, as they are after what happened.
pub trait Journal {
    /// Training begins, or goes on, with these agents.
    fn begun(&mut self, _agents: &AgentsState) -> Result<()> {
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

    /// The loss of the AIPs was measured on fresh episodes.
    fn aips_measured(&mut self, _agents: &AgentsState, _after: Moment, _losses: &[FreshLoss]) -> Result<()> {
        Ok(())
    }

    /// A period of training is over. Training can go on from here with `agents` and `standing`.
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

/// Writes nothing down.
pub struct Unrecorded;

impl Journal for Unrecorded {}
