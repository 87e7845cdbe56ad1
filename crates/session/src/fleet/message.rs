//! Messages between coordinator and workers.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use dials_core::base::{Activity, AgentId, Ragged};
use dials_learn::config::Period;
use dials_learn::evaluation::EpisodeReport;
use dials_learn::influence::{AipLoss, Dataset, FreshLoss};
use dials_learn::policy::{Demonstrations, JointPolicy};
use dials_learn::training::answers::{PolicyTraining, WorkerLoad};
use dials_learn::training::collect::Purpose;
use dials_learn::training::imitation::ImitationLoss;
use dials_learn::training::state::AgentsState;

/// Orders from the coordinator. Every order is answered by one [`WorkerReport::Done`] or [`WorkerReport::Failed`]. Orders that only
/// prepare the next one are answered by [`Answer::Ready`].
#[derive(Debug, Serialize, Deserialize)]
pub enum Order {
    /// First order: what the run is, which agents the worker owns, how many threads may train their policies, and what
    /// the coordinator prepared for all workers ([`dials_core::domain::Domain::prepare`]).
    Begin { config_json: String, agents: Vec<AgentId>, threads: usize, prepared: Option<Vec<u8>> },
    /// Continue from this state of its agents.
    Restore(AgentsState),
    /// Return the state of its agents.
    TellState,
    /// Policies of all agents, with which the next order plays episodes.
    TakePolicies(JointPolicy),
    /// Let a controller play these episodes and return what all agents saw and did.
    Demonstrate { controller: String, episodes: Range<usize> },
    /// Make the policies of its agents imitate their demonstrations.
    Imitate { demonstrations: Vec<Demonstrations> },
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

/// Result of an order.
#[derive(Debug, Serialize, Deserialize)]
pub enum Answer {
    /// Ready for the next order.
    Ready,
    State(AgentsState),
    Demonstrated(Vec<Demonstrations>),
    Imitated {
        losses: Vec<ImitationLoss>,
        policies: JointPolicy,
    },
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

/// Messages from a worker.
#[derive(Debug, Serialize, Deserialize)]
pub enum WorkerReport {
    /// Policies have been trained for this number of timesteps per agent.
    Trained { steps: u64 },
    /// This share of another activity is done.
    Busy { activity: Activity, share: f64 },
    /// The order is done. `load`: what the worker has spent since the last one.
    /// `resident_kib`: resident memory of its process now.
    Done { answer: Box<Answer>, load: Box<WorkerLoad>, resident_kib: u64 },
    /// The order cannot be done, for this reason, and would fail again.
    Failed { reason: String },
}
