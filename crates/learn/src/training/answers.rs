//! Results that workers return.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::algorithms::Metrics;
use dials_core::base::Timesheet;

/// Results of one period of training.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PolicyTraining {
    pub agents: Vec<AgentTraining>,
    /// Means over the period's updates.
    pub metrics: Metrics,
    /// Number of updates of every agent. Without any, the metrics mean nothing.
    pub updates: usize,
    /// Totals that the local simulators counted in the period.
    pub counters: Vec<(String, u64)>,
}

impl PolicyTraining {
    /// Joins the results of groups of agents in the same period, in order. Counters of the same name are added up.
    pub(crate) fn joined(parts: Vec<PolicyTraining>) -> PolicyTraining {
        let join = |mut whole: PolicyTraining, next: PolicyTraining| {
            whole.agents.extend(next.agents);
            whole.metrics.extend(next.metrics);
            for (name, more) in next.counters {
                match whole.counters.iter_mut().find(|(known, _)| *known == name) {
                    Some((_, count)) => *count = count.saturating_add(more),
                    None => whole.counters.push((name, more)),
                }
            }
            whole
        };
        parts.into_iter().reduce(join).expect("somebody trained")
    }
}

/// One agent's episodes of a period.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentTraining {
    /// Mean return of the episodes that ended in the period, on the simulator that the agent trained on.
    pub mean_return: Option<f64>,
    pub episodes: u64,
}

/// What a fleet has spent.
#[derive(Clone, Debug, Default)]
pub struct FleetLoad {
    pub workers: Vec<WorkerLoad>,
    /// Wall time in which at least one worker had an order. Messages and files took the rest.
    pub at_work: Duration,
    /// Memory of the coordinator's process; `None` if that process is itself the worker.
    pub coordinator: Option<Footprint>,
    /// CPU time of the coordinator's process.
    pub coordinator_cpu: Duration,
}

/// What one worker has spent.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WorkerLoad {
    pub timesheet: Timesheet,
    pub footprint: Footprint,
}

/// Memory of a process, in KiB; 0 if the system does not report it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Footprint {
    /// Peak resident memory, shared libraries counted in full.
    pub peak_rss_kib: u64,
    /// Proportional share: each shared page is divided among the processes that share it, so these can be added up.
    pub pss_kib: u64,
}

impl Footprint {
    /// Returns the larger value of each figure.
    pub fn max(self, other: Footprint) -> Footprint {
        Footprint { peak_rss_kib: self.peak_rss_kib.max(other.peak_rss_kib), pss_kib: self.pss_kib.max(other.pss_kib) }
    }
}
