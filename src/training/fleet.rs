//! Who does the work: the fleet of workers, as Algorithm 1 sees it.

use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::footprint::Footprint;
use super::observer::Observer;
use super::ppo::{Decayed, Losses};
use super::state::AgentsState;
use super::worker::Worker;
use crate::base::{AgentId, Rows, Stopwatch};
use crate::config::{Config, Period};
use crate::domain::{Domain, Result};
use crate::evaluation::Evaluation;
use crate::influence::{AipLoss, Dataset};
use crate::policy::JointPolicy;

/// Workers that together own all agents. Results do not depend on how many there are.
pub trait Fleet {
    /// Algorithm 2: one dataset per agent.
    fn collect_datasets(&mut self, policies: &JointPolicy, period: &Period) -> Result<Vec<Dataset>>;

    /// Trains every agent's AIP on its dataset.
    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<AipTraining>;

    /// Trains all policies until the end of the period.
    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining>;

    /// Evaluates the joint policy on the GS.
    fn evaluate(&mut self, policies: &JointPolicy) -> Result<Evaluation>;

    /// The state of all agents.
    fn state(&mut self) -> Result<AgentsState>;

    /// Goes on from a state of all agents.
    fn restore(&mut self, state: &AgentsState) -> Result<()>;

    /// What the fleet has been doing since the last call.
    fn take_load(&mut self) -> FleetLoad;
}

/// What a training of the AIPs brought.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AipTraining {
    /// Per agent.
    pub losses: Vec<AipLoss>,
    /// One row per agent.
    pub parameters: Rows<f32>,
}

/// What a period of training brought.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PolicyTraining {
    pub agents: Vec<AgentTraining>,
    /// Totals that the local simulators counted in the period.
    pub counters: Vec<(String, u64)>,
    /// Of the period's last update, the same for all agents.
    pub decayed: Decayed,
}

impl AipTraining {
    /// Of all agents, from those of some, in order.
    pub fn joined(parts: Vec<AipTraining>) -> AipTraining {
        let join = |mut whole: AipTraining, next: AipTraining| {
            whole.losses.extend(next.losses);
            whole.parameters.extend(&next.parameters);
            whole
        };
        parts.into_iter().reduce(join).expect("somebody trained")
    }
}

impl PolicyTraining {
    /// Of all agents, from those of some in the same period, in order.
    pub fn joined(parts: Vec<PolicyTraining>) -> PolicyTraining {
        let join = |mut whole: PolicyTraining, next: PolicyTraining| {
            whole.agents.extend(next.agents);
            whole.counters.iter_mut().zip(next.counters).for_each(|((_, count), (_, more))| *count += more);
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
}

/// What one worker has been doing.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WorkerLoad {
    pub watch: Stopwatch,
    pub footprint: Footprint,
}

/// All agents in this process.
pub struct InlineFleet {
    worker: Worker,
    domain: Arc<dyn Domain>,
    config: Config,
    observer: Rc<dyn Observer>,
    at_work: Duration,
}

impl InlineFleet {
    pub fn new(domain: Arc<dyn Domain>, config: &Config, observer: Rc<dyn Observer>) -> Self {
        let worker = Worker::new(domain.clone(), config, AgentId::all(domain.agents()));
        InlineFleet { worker, domain, config: config.clone(), observer, at_work: Duration::ZERO }
    }

    fn work<T>(&mut self, order: impl FnOnce(&mut Worker, &dyn Observer) -> T) -> T {
        let begun = Instant::now();
        let answer = order(&mut self.worker, &*self.observer);
        self.at_work += begun.elapsed();
        answer
    }
}

impl Fleet for InlineFleet {
    fn collect_datasets(&mut self, policies: &JointPolicy, period: &Period) -> Result<Vec<Dataset>> {
        let episodes = 0..self.config.dataset_episodes(self.domain.spec().horizon);
        self.work(|worker, observer| worker.collect(policies, period, episodes, observer))
    }

    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<AipTraining> {
        Ok(self.work(|worker, observer| worker.train_aips(&datasets, period, observer)))
    }

    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining> {
        self.work(|worker, observer| worker.train_policies(period, observer))
    }

    fn evaluate(&mut self, policies: &JointPolicy) -> Result<Evaluation> {
        let episodes = 0..self.config.evaluation.episodes;
        let reports = self.work(|worker, observer| worker.evaluate(policies, episodes, observer))?;
        Ok(Evaluation::new(&*self.domain, &reports))
    }

    fn state(&mut self) -> Result<AgentsState> {
        Ok(self.worker.state())
    }

    fn restore(&mut self, state: &AgentsState) -> Result<()> {
        self.worker.restore(state);
        Ok(())
    }

    fn take_load(&mut self) -> FleetLoad {
        let worker = WorkerLoad { watch: self.worker.take_watch(), footprint: Footprint::of_this_process() };
        FleetLoad { workers: vec![worker], at_work: std::mem::take(&mut self.at_work), coordinator: None }
    }
}
