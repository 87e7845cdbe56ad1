//! The fleet of workers, as the steps of Algorithm 1 see it.

use std::ops::Range;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::config::Config;
use crate::state::AgentsState;
use crate::steps::Step;
use dials_core::base::{Activity, Timesheet};
use dials_core::domain::{Domain, Result};

/// When a request to stop takes effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// At once, because nothing is lost.
    AtOnce,
    /// Later, because a period's work would be lost.
    Later,
}

/// Workers that together own all agents. Results do not depend on their number.
pub trait Fleet {
    fn config(&self) -> &Config;

    fn domain(&self) -> &dyn Domain;

    /// Returns the agents after the last training, or as the run began.
    fn agents(&self) -> &AgentsState;

    /// Continues from a state of all agents.
    fn restore(&mut self, agents: AgentsState) -> Result<()>;

    /// Changes the state of all agents, here and at the workers.
    fn change(&mut self, change: impl FnOnce(&mut AgentsState)) -> Result<()>;

    /// Keeps the new state of a predictor outside of this program: [`AgentsState::outside_aips`].
    fn keep_outside_aips(&mut self, state: Vec<u8>);

    /// Shares episodes out among all workers. Returns their replies, in the order of the episodes. A request to stop
    /// takes effect at once.
    ///
    /// `with_policies`: whether the workers need the joint policy.
    fn ask_all<S: Step>(
        &mut self,
        activity: Activity,
        episodes: usize,
        with_policies: bool,
        step: impl FnMut(Range<usize>) -> S,
    ) -> Result<Vec<S::Reply>>;

    /// Asks every worker that owns agents; `step` gets its agents, in order. `take` gets every reply with the state of
    /// all agents and the agents of the worker, in any order. Returns what it returned, in the order of the agents.
    fn ask_owners<S: Step, T>(
        &mut self,
        activity: Activity,
        stop: Stop,
        step: impl FnMut(Range<usize>) -> S,
        take: impl FnMut(&mut AgentsState, Range<usize>, S::Reply) -> T,
    ) -> Result<Vec<T>>;

    /// Notes that a period of training is over.
    fn period_done(&mut self) {}

    /// Returns what the fleet has spent since the last call.
    fn take_load(&mut self) -> FleetLoad;
}

/// Takes the items of some agents from the front of a list with one item per agent. Owners are asked in order.
pub(crate) fn of_owners<T>(items: &mut Vec<T>, agents: &Range<usize>) -> Vec<T> {
    items.drain(..agents.len()).collect()
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
    /// Returns the sums of each figure, of processes that run at the same time.
    pub fn and(self, other: Footprint) -> Footprint {
        Footprint { peak_rss_kib: self.peak_rss_kib + other.peak_rss_kib, pss_kib: self.pss_kib + other.pss_kib }
    }

    /// Returns the larger value of each figure.
    pub fn max(self, other: Footprint) -> Footprint {
        Footprint { peak_rss_kib: self.peak_rss_kib.max(other.peak_rss_kib), pss_kib: self.pss_kib.max(other.pss_kib) }
    }
}
