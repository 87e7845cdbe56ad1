//! What workers bring back from their work.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::ppo::{Decayed, Losses};
use crate::base::Timesheet;

/// What a period of training brought.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PolicyTraining {
    pub agents: Vec<AgentTraining>,
    /// Totals that the local simulators counted in the period.
    pub counters: Vec<(String, u64)>,
    /// Of the period's last update, the same for all agents.
    pub decayed: Decayed,
}

impl PolicyTraining {
    /// Of all agents, from those of some in the same period, in order. Counters of one name are added up.
    pub fn joined(parts: Vec<PolicyTraining>) -> PolicyTraining {
        let join = |mut whole: PolicyTraining, next: PolicyTraining| {
            whole.agents.extend(next.agents);
            for (name, more) in next.counters {
                match whole.counters.iter_mut().find(|(known, _)| *known == name) {
                    Some((_, count)) => *count += more,
                    None => whole.counters.push((name, more)),
                }
            }
            whole
        };
        parts.into_iter().reduce(join).expect("somebody trained")
    }
}

/// One agent's share of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentTraining {
    /// Of the episodes that ended in the period, on the simulator that it trained on.
    pub mean_return: Option<f64>,
    pub episodes: u64,
    /// Means over the period's updates.
    pub losses: Losses,
}

/// What a fleet has been doing.
#[derive(Clone, Debug, Default)]
pub struct FleetLoad {
    pub workers: Vec<WorkerLoad>,
    /// Wall time in which at least one worker had an order; the rest went into exchanges and files.
    pub at_work: Duration,
    /// Of the process that gives the orders, where that is none of the workers.
    pub coordinator: Option<Footprint>,
    /// CPU time of that process.
    pub coordinator_cpu: Duration,
}

/// What one worker has been doing.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WorkerLoad {
    pub timesheet: Timesheet,
    pub footprint: Footprint,
}

/// Memory of a process, in KiB; 0 where the system does not tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Footprint {
    /// The most resident memory it ever had, shared libraries counted in full.
    pub peak_rss_kib: u64,
    /// Its proportional share: shared pages count once among those who share them, so these add up.
    pub pss_kib: u64,
}

impl Footprint {
    /// The larger of each figure.
    pub fn max(self, other: Footprint) -> Footprint {
        Footprint { peak_rss_kib: self.peak_rss_kib.max(other.peak_rss_kib), pss_kib: self.pss_kib.max(other.pss_kib) }
    }
}
