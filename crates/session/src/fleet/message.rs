//! Messages between coordinator and workers, and which of them cannot be right.

use std::time::Duration;

use anyhow::{Result, bail, ensure};
use serde::{Deserialize, Serialize};

use dials_core::base::{Activity, AgentId};
use dials_learn::fleet::WorkerLoad;
use dials_learn::policy::JointPolicy;
use dials_learn::state::AgentsState;
use dials_learn::steps::{Reply, Request};

/// Orders from the coordinator. [`WorkerReport::Done`] or `Failed` answers a step; the other orders prepare one.
#[derive(Debug, Serialize, Deserialize)]
pub enum Order {
    /// First order: what the run is, which agents the worker owns, how many threads may train their policies, and what
    /// the coordinator prepared for all workers ([`dials_core::domain::Domain::prepare`]).
    Begin {
        config_json: String,
        agents: Vec<AgentId>,
        threads: usize,
        prepared: Option<Vec<u8>>,
    },
    /// Continue from this state of its agents.
    Restore(AgentsState),
    /// Policies of all agents, with which the next step plays episodes.
    TakePolicies(JointPolicy),
    Step(Request),
}

#[derive(Debug, Serialize, Deserialize)]
pub enum WorkerReport {
    /// It has begun, and waits for its first step.
    Begun,
    /// Policies have been trained for this number of timesteps per agent.
    Trained { steps: u64 },
    /// This share of another activity is done.
    Busy { activity: Activity, share: f64 },
    /// The step is done. `load`: what the worker has spent since the last one. `resident_kib`: its memory now.
    Done { reply: Box<Reply>, load: Box<WorkerLoad>, resident_kib: u64 },
    /// The step cannot be done, for this reason, and would fail again.
    Failed { reason: String },
}

/// Longest time that a worker may report, about ten years.
const LONGEST: Duration = Duration::from_secs(10 * 365 * 24 * 3600);
/// Largest memory that a worker may report.
const LARGEST_KIB: u64 = 1 << 50;

impl WorkerReport {
    /// Returns an error if this cannot be right, whatever the step is. `most_steps`: up to which timestep it may train.
    pub(super) fn check(&self, most_steps: Option<u64>) -> Result<()> {
        match self {
            WorkerReport::Begun | WorkerReport::Failed { .. } => {}
            WorkerReport::Trained { steps } => {
                let Some(most) = most_steps else { bail!("it trained without an order to") };
                ensure!(*steps <= most, "it trained for {steps} steps, of at most {most}");
            }
            WorkerReport::Busy { share, .. } => {
                ensure!((0.0..1.01).contains(share), "it has done {share} of its work");
            }
            WorkerReport::Done { load, .. } => {
                let WorkerLoad { timesheet, footprint } = &**load;
                ensure!(timesheet.longest() <= LONGEST, "it worked for {:?}", timesheet.longest());
                let largest = footprint.peak_rss_kib.max(footprint.pss_kib);
                ensure!(largest <= LARGEST_KIB, "it uses {largest} KiB of memory");
            }
        }
        Ok(())
    }
}
