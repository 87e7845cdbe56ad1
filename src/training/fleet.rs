//! Who does the work: the fleet of workers, as Algorithm 1 sees it.

use std::ops::Range;
use std::rc::Rc;
use std::sync::Arc;

use super::ppo::Losses;
use super::worker::Worker;
use crate::base::{AgentId, Phase, Rows, Stopwatch};
use crate::config::{Config, Period};
use crate::domain::{Domain, Result};
use crate::evaluation::Evaluation;
use crate::influence::{AipLoss, Dataset};
use crate::policy::JointPolicy;

/// Workers that together own all agents. Results do not depend on how many there are.
pub trait Fleet {
    fn initial_policies(&mut self) -> Result<JointPolicy>;

    /// Algorithm 2: one dataset per agent.
    fn collect_datasets(&mut self, policies: &JointPolicy, period: &Period) -> Result<Vec<Dataset>>;

    /// Trains every agent's AIP on its dataset.
    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<AipTraining>;

    /// Trains all policies until the end of the period.
    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining>;

    /// Evaluates the joint policy on the GS.
    fn evaluate(&mut self, policies: &JointPolicy) -> Result<Evaluation>;
}

/// What a training of the AIPs brought.
#[derive(Clone, Debug)]
pub struct AipTraining {
    /// Per agent.
    pub losses: Vec<AipLoss>,
    /// One row per agent.
    pub parameters: Rows<f32>,
    pub watch: Stopwatch,
}

/// What a period of training brought.
#[derive(Clone, Debug)]
pub struct PolicyTraining {
    /// Timesteps per agent since the beginning of the run.
    pub steps: u64,
    pub policies: JointPolicy,
    pub agents: Vec<AgentTraining>,
    /// Totals that the local simulators counted in the period.
    pub counters: Vec<(String, u64)>,
    pub watch: Stopwatch,
}

/// One agent's share of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgentTraining {
    /// Of the episodes that ended in the period, on the simulator that it trained on.
    pub mean_return: Option<f64>,
    pub episodes: u64,
    /// Means over the period's updates.
    pub losses: Losses,
}

/// Watches the work go on.
pub trait Observer {
    /// The policies have been trained for so many timesteps per agent.
    fn trained(&self, steps: u64);

    /// Something else is going on, and this share of it (`0..=1`) is done.
    fn busy(&self, phase: Phase, share: f64);
}

/// All agents in this process.
pub struct InlineFleet {
    worker: Worker,
    domain: Arc<dyn Domain>,
    config: Config,
    observer: Rc<dyn Observer>,
}

impl InlineFleet {
    pub fn new(domain: Arc<dyn Domain>, config: &Config, observer: Rc<dyn Observer>) -> Self {
        let worker = Worker::new(domain.clone(), config, AgentId::all(domain.agents()));
        InlineFleet { worker, domain, config: config.clone(), observer }
    }

    fn dataset_episodes(&self) -> Range<usize> {
        0..self.config.aip.dataset_steps.div_ceil(self.domain.spec().horizon)
    }
}

impl Fleet for InlineFleet {
    fn initial_policies(&mut self) -> Result<JointPolicy> {
        Ok(self.worker.policies())
    }

    fn collect_datasets(&mut self, policies: &JointPolicy, period: &Period) -> Result<Vec<Dataset>> {
        self.worker.collect(policies, period, self.dataset_episodes(), &*self.observer)
    }

    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<AipTraining> {
        Ok(self.worker.train_aips(&datasets, period, &*self.observer))
    }

    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining> {
        self.worker.train_policies(period, &*self.observer)
    }

    fn evaluate(&mut self, policies: &JointPolicy) -> Result<Evaluation> {
        let episodes = 0..self.config.evaluation.episodes;
        let reports = self.worker.evaluate(policies, episodes, &*self.observer)?;
        Ok(Evaluation::new(&*self.domain, &reports))
    }
}
