//! Lines 7 to 12 of Algorithm 1: the training of the policies until the end of a period, or a part of it.

use std::ops::Range;
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
    /// What the period has brought its agents before, if it is the rest of one.
    pub so_far: Option<PolicyTraining>,
}

impl Step for TrainPolicies {
    type Reply = (PolicyTraining, AgentsState);

    /// Trains block after block, or all at once on the GS.
    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<(PolicyTraining, AgentsState)> {
        let TrainPolicies { period, so_far } = &self;
        let so_far = worker.by_block(|places| so_far.as_ref().map(|so_far| so_far.share(places)));
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let count = worker.blocks.len() as u64;
        let mut parts = Vec::new();
        if worker.config.simulator == Simulator::Global {
            let progress = &mut |steps| observer.trained(steps);
            let work = Work { watch: &mut watch, progress };
            let Worker { domain, config, blocks, makers, .. } = worker;
            let make = || makers.copies(&**domain, config.copies());
            let simulators = work.watch.time(Phase::Loading, make)?;
            parts = train_policies_on_the_gs(simulators, domain.kinds(), config, blocks, (period, so_far), work)?;
        } else {
            let Worker { blocks, makers, .. } = &mut *worker;
            for ((done, block), so_far) in (0..).zip(blocks).zip(so_far) {
                // The mean over all agents.
                let average = |steps| (done * period.end + steps + (count - done - 1) * period.start) / count;
                let progress = &mut |steps| observer.trained(average(steps));
                parts.push(block.train_policies((period, so_far), &**makers, Work { watch: &mut watch, progress })?);
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
            training.check(fit.agents.len())?;
            let end = fit.config.update_at_or_after(end);
            ensure!(state.steps == end, "its agents are at step {}, not at {end}", state.steps);
            fit.check(state)
        })
    }

    fn trains_until(&self) -> Option<u64> {
        Some(self.period.end)
    }
}

/// Results of one period of training: sums, to which more of the same period can be added without another rounding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyTraining {
    pub agents: Vec<AgentTraining>,
    /// Sums over the period's updates.
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
            whole.count(next.counters);
            whole
        };
        parts.into_iter().reduce(join).expect("somebody trained")
    }

    fn count(&mut self, counters: Vec<(String, u64)>) {
        for (name, more) in counters {
            match self.counters.iter_mut().find(|(known, _)| *known == name) {
                Some((_, count)) => *count = count.saturating_add(more),
                None => self.counters.push((name, more)),
            }
        }
    }

    /// Returns what is of some agents, so without the counters.
    fn share(&self, agents: &[usize]) -> PolicyTraining {
        PolicyTraining {
            agents: agents.iter().map(|&agent| self.agents[agent]).collect(),
            metrics: self.metrics.share(agents.iter().copied()),
            updates: self.updates,
            counters: Vec::new(),
        }
    }

    /// Returns an error unless these are figures of this number of agents.
    pub(crate) fn check(&self, agents: usize) -> Result<()> {
        ensure!(self.agents.len() == agents, "it trained {} agents", self.agents.len());
        let complete = self.metrics.of_agents.iter().all(|(_, values)| values.len() == agents);
        ensure!(complete, "its metrics are not of {agents} agents");
        Ok(())
    }

    /// Returns the means over the updates of a figure with these sums.
    pub fn mean(&self, sum: f64) -> f64 {
        sum / self.updates as f64
    }
}

/// One agent's episodes that ended in a period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentTraining {
    /// Sum of their returns, on the simulator that the agent trained on.
    pub returns: f64,
    pub episodes: u64,
}

impl AgentTraining {
    /// Returns the mean return of the episodes, if there were any.
    pub fn mean_return(&self) -> Option<f64> {
        (self.episodes > 0).then(|| self.returns / self.episodes as f64)
    }
}

/// Trains all policies until the end of the period. `so_far`: what the same period has brought before.
pub fn train_policies(
    fleet: &mut impl Fleet,
    period: &Period,
    mut so_far: Option<PolicyTraining>,
) -> Result<PolicyTraining> {
    let counters = so_far.as_mut().map(|so_far| std::mem::take(&mut so_far.counters)).unwrap_or_default();
    let step = |agents: Range<usize>| {
        let agents: Vec<usize> = agents.collect();
        TrainPolicies { period: *period, so_far: so_far.as_ref().map(|so_far| so_far.share(&agents)) }
    };
    let parts = fleet.ask_owners(Activity::Training, Stop::Later, step, |whole, agents, (training, state)| {
        whole.replace(agents.start, &state);
        training
    })?;
    fleet.period_done();
    let mut training = PolicyTraining::joined(parts);
    training.count(counters);
    Ok(training)
}
