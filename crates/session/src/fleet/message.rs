//! Messages between coordinator and workers.

use serde::{Deserialize, Serialize};

use dials_core::base::{Activity, AgentId};
use dials_learn::fleet::WorkerLoad;
use dials_learn::policy::JointPolicy;
use dials_learn::state::AgentsState;
use dials_learn::steps::{Reply, Request};

/// Orders from the coordinator. Every step is answered by one [`WorkerReport::Done`] or [`WorkerReport::Failed`]. The
/// other orders prepare the next step.
#[derive(Debug, Serialize, Deserialize)]
pub enum Order {
    /// First order: what the run is, which agents the worker owns, how many threads may train their policies, and what
    /// the coordinator prepared for all workers ([`dials_core::domain::Domain::prepare`]).
    Begin { config_json: String, agents: Vec<AgentId>, threads: usize, prepared: Option<Vec<u8>> },
    /// Continue from this state of its agents.
    Restore(AgentsState),
    /// Policies of all agents, with which the next step plays episodes.
    TakePolicies(JointPolicy),
    /// Carry out a step of Algorithm 1.
    Step(Request),
}

/// Messages from a worker.
#[derive(Debug, Serialize, Deserialize)]
pub enum WorkerReport {
    /// It has begun, and waits for its first step.
    Begun,
    /// Policies have been trained for this number of timesteps per agent.
    Trained { steps: u64 },
    /// This share of another activity is done.
    Busy { activity: Activity, share: f64 },
    /// The step is done. `load`: what the worker has spent since the last one.
    /// `resident_kib`: resident memory of its process now.
    Done { reply: Box<Reply>, load: Box<WorkerLoad>, resident_kib: u64 },
    /// The step cannot be done, for this reason, and would fail again.
    Failed { reason: String },
}
