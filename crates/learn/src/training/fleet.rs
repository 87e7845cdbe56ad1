//! The fleet of workers, as Algorithm 1 sees it.

use super::answers::{FleetLoad, PolicyTraining};
use super::collect::Purpose;
use super::imitation::ImitationLoss;
use super::state::AgentsState;
use crate::config::Period;
use crate::evaluation::Evaluation;
use crate::influence::{AipLoss, Dataset, FreshLoss};
use crate::policy::Demonstrations;
use dials_core::domain::Result;

/// Workers that together own all agents. Results do not depend on the number of workers.
pub trait Fleet {
    /// Returns the agents after the last training, or as the run began.
    fn agents(&self) -> &AgentsState;

    /// Continues from a state of all agents.
    fn restore(&mut self, agents: AgentsState) -> Result<()>;

    /// Evaluates the joint policy on the GS, on the first `episodes` evaluation episodes.
    fn evaluate(&mut self, episodes: usize) -> Result<Evaluation>;

    /// Lets a controller play on the GS. Returns what every agent saw and did.
    fn collect_demonstrations(&mut self, controller: &str) -> Result<Vec<Demonstrations>>;

    /// Makes every agent's policy imitate its demonstrations, and returns how well it does.
    fn imitate(&mut self, demonstrations: Vec<Demonstrations>) -> Result<Vec<ImitationLoss>>;

    /// Runs Algorithm 2: one dataset per agent, under the joint policy.
    fn collect_datasets(&mut self, purpose: Purpose) -> Result<Vec<Dataset>>;

    /// Trains every agent's AIP (approximate influence predictor) on its dataset and returns the losses.
    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<Vec<AipLoss>>;

    /// Measures the loss of every agent's AIP on its dataset.
    fn measure_aips(&mut self, datasets: Vec<Dataset>) -> Result<Vec<FreshLoss>>;

    /// Trains all policies until the end of the period.
    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining>;

    /// Gives all agents of a kind the mean of their policies.
    fn average_policies(&mut self) -> Result<()>;

    /// Returns what the fleet has spent since the last call.
    fn take_load(&mut self) -> FleetLoad;
}
