//! What coordinator and workers say to each other.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::base::{Activity, AgentId, Ragged};
use crate::config::Period;
use crate::evaluation::EpisodeReport;
use crate::influence::{AipLoss, Dataset, FreshLoss};
use crate::policy::JointPolicy;
use crate::training::answers::{PolicyTraining, WorkerLoad};
use crate::training::collect::Purpose;
use crate::training::state::AgentsState;

/// From the coordinator. Every order is answered by one [`Report::Done`] or [`Report::Failed`];
/// those that only prepare the next one by [`Answer::Ready`].
#[derive(Debug, Serialize, Deserialize)]
pub enum Order {
    /// The first one: what the run is, whom the worker owns, and how many threads may train their policies.
    Begin { config_json: String, agents: Vec<AgentId>, threads: usize },
    /// Go on from this state of its agents.
    Restore(AgentsState),
    /// Tell the state of its agents.
    TellState,
    /// The policies of all agents, for the next order to play episodes.
    TakePolicies(JointPolicy),
    /// Play these episodes and return the datasets of all agents.
    Collect { purpose: Purpose, episodes: Range<usize> },
    /// Train the AIPs of its agents on their datasets.
    TrainAips { datasets: Vec<Dataset>, period: Period },
    /// Measure the loss of the AIPs of its agents on their datasets.
    MeasureAips { datasets: Vec<Dataset> },
    /// Train the policies of its agents until the end of the period.
    TrainPolicies { period: Period },
    /// Play these evaluation episodes.
    Evaluate { episodes: Range<usize> },
}

/// What an order brought.
#[derive(Debug, Serialize, Deserialize)]
pub enum Answer {
    /// For the next order.
    Ready,
    State(AgentsState),
    Collected(Vec<Dataset>),
    AipsTrained {
        losses: Vec<AipLoss>,
        aips: Ragged<f32>,
    },
    AipsMeasured(Vec<FreshLoss>),
    PoliciesTrained {
        training: PolicyTraining,
        state: AgentsState,
    },
    Evaluated(Vec<EpisodeReport>),
}

/// From a worker.
#[derive(Debug, Serialize, Deserialize)]
pub enum Report {
    /// Policies are trained for so many timesteps per agent.
    Trained { steps: u64 },
    /// This share of something else is done.
    Busy { activity: Activity, share: f64 },
    /// The order is done; what the worker has been doing since the last one.
    Done { answer: Box<Answer>, load: Box<WorkerLoad> },
    /// The order cannot be done, for this reason, and would fail again.
    Failed { reason: String },
}
