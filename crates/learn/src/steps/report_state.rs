//! The state of a worker's agents, which a fleet asks for at the beginning of a run.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step};
use crate::observer::Observer;
use crate::state::AgentsState;
use crate::worker::Worker;
use dials_core::domain::Result;

/// Asks for the state of the worker's agents before the first step.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct ReportState;

impl Step for ReportState {
    type Reply = AgentsState;

    fn run(self, worker: &mut Worker, _observer: &dyn Observer) -> Result<AgentsState> {
        Ok(worker.state())
    }

    fn check(&self) -> Check<AgentsState> {
        Box::new(|state, fit| {
            ensure!(state.steps == 0, "its agents are at step {}, not at 0", state.steps);
            fit.check(state)
        })
    }
}
