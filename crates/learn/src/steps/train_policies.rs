//! Lines 7 to 12 of Algorithm 1: the training of the policies until the end of a period.

use std::time::Instant;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{Check, Step};
use crate::algorithms::Metrics;
use crate::config::{Period, Simulator};
use crate::fleet::{Fleet, Stop};
use crate::observer::Observer;
use crate::state::AgentsState;
use crate::worker::Worker;
use crate::worker::block::train_policies_on_the_gs;
use dials_core::base::{Activity, Phase, Stopwatch, Work};
use dials_core::domain::Result;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrainPolicies {
    pub period: Period,
}

impl Step for TrainPolicies {
    type Reply = (PolicyTraining, AgentsState);

    /// Trains block after block, or all at once on the GS.
    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<(PolicyTraining, AgentsState)> {
        let period = &self.period;
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let count = worker.blocks.len() as u64;
        let mut parts = Vec::new();
        if worker.config.simulator == Simulator::Global {
            let progress = &mut |steps| observer.trained(steps);
            let work = Work { watch: &mut watch, progress };
            let Worker { domain, config, blocks, makers, .. } = worker;
            let make = || makers.copies(&**domain, config.copies());
            let simulators = work.watch.time(Phase::Loading, make)?;
            parts = train_policies_on_the_gs(simulators, domain.kinds(), config, blocks, period, work)?;
        } else {
            let Worker { blocks, makers, .. } = &mut *worker;
            for (done, block) in (0..).zip(blocks) {
                // The mean over all agents.
                let average = |steps| (done * period.end + steps + (count - done - 1) * period.start) / count;
                let progress = &mut |steps| observer.trained(average(steps));
                parts.push(block.train_policies(period, &**makers, Work { watch: &mut watch, progress })?);
            }
        }
        worker.note(Activity::Training, begun.elapsed(), &watch);
        let mut training = PolicyTraining::joined(parts);
        training.agents = worker.in_order(training.agents);
        for (_, values) in &mut training.metrics.of_agents {
            *values = worker.in_order(std::mem::take(values));
        }
        Ok((training, worker.state()))
    }

    fn check(&self) -> Check<(PolicyTraining, AgentsState)> {
        let end = self.period.end;
        Box::new(move |(training, state), fit| {
            let agents = fit.agents.len();
            ensure!(training.agents.len() == agents, "it trained {} agents", training.agents.len());
            let complete = training.metrics.of_agents.iter().all(|(_, values)| values.len() == agents);
            ensure!(complete, "its metrics are not of {agents} agents");
            let end = fit.config.update_at_or_after(end);
            ensure!(state.steps == end, "its agents are at step {}, not at {end}", state.steps);
            fit.check(state)
        })
    }

    fn trains_until(&self) -> Option<u64> {
        Some(self.period.end)
    }
}

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

/// Trains all policies until the end of the period.
pub fn train_policies(fleet: &mut impl Fleet, period: &Period) -> Result<PolicyTraining> {
    let step = |_| TrainPolicies { period: *period };
    let parts = fleet.ask_owners(Activity::Training, Stop::Later, step, |whole, agents, (training, state)| {
        whole.replace(agents.start, &state);
        training
    })?;
    fleet.period_done();
    Ok(PolicyTraining::joined(parts))
}
