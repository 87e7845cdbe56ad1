//! Who does the work: the fleet of workers, as Algorithm 1 sees it.

use super::answers::{AipTraining, FleetLoad, PolicyTraining};
use super::state::AgentsState;
use crate::config::Period;
use crate::domain::Result;
use crate::evaluation::Evaluation;
use crate::influence::Dataset;
use crate::policy::JointPolicy;

/// Workers that together own all agents. Results do not depend on how many there are.
pub trait Fleet {
    /// Algorithm 2: one dataset per agent.
    fn collect_datasets(&mut self, policies: &JointPolicy, period: &Period) -> Result<Vec<Dataset>>;

    /// Trains every agent's AIP on its dataset.
    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<AipTraining>;

    /// Trains all policies until the end of the period.
    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining>;

    /// Evaluates the joint policy on the GS.
    fn evaluate(&mut self, policies: &JointPolicy) -> Result<Evaluation>;

    /// The state of all agents.
    fn state(&mut self) -> Result<AgentsState>;

    /// Goes on from a state of all agents.
    fn restore(&mut self, state: &AgentsState) -> Result<()>;

    /// What the fleet has been doing since the last call.
    fn take_load(&mut self) -> FleetLoad;
}
