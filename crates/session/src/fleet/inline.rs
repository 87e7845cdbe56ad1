//! The smallest fleet: one worker, in this process.

use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::footprint::{CpuClock, footprint};
use super::worker::Worker;
use dials_core::base::{Activity, AgentId, Timesheet};
use dials_core::domain::{Domain, Result};
use dials_learn::config::{Config, Period};
use dials_learn::evaluation::Evaluation;
use dials_learn::influence::{AipLoss, Dataset, FreshLoss};
use dials_learn::policy::Demonstrations;
use dials_learn::training::answers::{FleetLoad, PolicyTraining, WorkerLoad};
use dials_learn::training::averaging::average;
use dials_learn::training::collect::Purpose;
use dials_learn::training::fleet::Fleet;
use dials_learn::training::imitation::ImitationLoss;
use dials_learn::training::observer::{Interrupted, Observer};
use dials_learn::training::state::AgentsState;
use stacknets::Threads;

/// All agents in this process.
pub struct InlineFleet {
    worker: Worker,
    agents: AgentsState,
    domain: Arc<dyn Domain>,
    config: Config,
    observer: Rc<dyn Observer>,
    at_work: Duration,
    timesheet: Timesheet,
    clock: CpuClock,
}

impl InlineFleet {
    pub fn new(domain: Arc<dyn Domain>, config: &Config, observer: Rc<dyn Observer>) -> Self {
        let worker = Worker::new(domain.clone(), config, AgentId::all(domain.agents()), &Threads::one());
        let agents = worker.state();
        InlineFleet {
            worker,
            agents,
            domain,
            config: config.clone(),
            observer,
            at_work: Duration::ZERO,
            timesheet: Timesheet::default(),
            clock: CpuClock::from_now(),
        }
    }

    fn work<T>(&mut self, order: impl FnOnce(&mut Worker, &AgentsState, &dyn Observer) -> T) -> T {
        // What was done since the last order belongs to none.
        self.timesheet.add(&Timesheet::of_cpu(self.clock.lap()));
        let begun = Instant::now();
        let answer = order(&mut self.worker, &self.agents, &*self.observer);
        self.at_work += begun.elapsed();
        let mut timesheet = self.worker.take_timesheet();
        timesheet.note_cpu(self.clock.lap());
        self.timesheet.add(&timesheet);
        answer
    }

    /// Reports what begins. An error if the run was asked to stop: before these orders nothing is lost.
    fn begin(&self, activity: Activity) -> Result<()> {
        self.observer.busy(activity, 0.0);
        if self.observer.stop_requested() { Err(Interrupted.into()) } else { Ok(()) }
    }
}

impl Fleet for InlineFleet {
    fn agents(&self) -> &AgentsState {
        &self.agents
    }

    fn restore(&mut self, agents: AgentsState) -> Result<()> {
        self.worker.restore(&agents);
        self.agents = agents;
        Ok(())
    }

    fn evaluate(&mut self, episodes: usize) -> Result<Evaluation> {
        self.begin(Activity::Evaluation)?;
        let reports = self.work(|worker, agents, observer| worker.evaluate(&agents.policies, 0..episodes, observer))?;
        Ok(Evaluation::new(&*self.domain, &reports))
    }

    fn collect_demonstrations(&mut self, controller: &str) -> Result<Vec<Demonstrations>> {
        self.begin(Activity::Collection)?;
        let episodes = 0..self.config.imitation.episodes(self.domain.kinds().horizon());
        self.work(|worker, _, observer| worker.demonstrate(controller, episodes, observer))
    }

    fn imitate(&mut self, demonstrations: Vec<Demonstrations>) -> Result<Vec<ImitationLoss>> {
        self.begin(Activity::Training)?;
        let losses = self.work(|worker, _, observer| worker.imitate(demonstrations, observer));
        self.agents.policies = self.worker.policies();
        Ok(losses)
    }

    fn collect_datasets(&mut self, purpose: Purpose) -> Result<Vec<Dataset>> {
        self.begin(purpose.activity(&self.config))?;
        let episodes = 0..purpose.episodes(&self.config, self.domain.kinds().horizon());
        self.work(|worker, agents, observer| worker.collect(&agents.policies, purpose, episodes, observer))
    }

    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<Vec<AipLoss>> {
        self.begin(Activity::AipTraining)?;
        let losses = self.work(|worker, _, observer| worker.train_aips(datasets, period, observer));
        self.agents.aips = self.worker.aips();
        Ok(losses)
    }

    fn measure_aips(&mut self, datasets: Vec<Dataset>) -> Result<Vec<FreshLoss>> {
        self.begin(Activity::Evaluation)?;
        Ok(self.work(|worker, _, _| worker.measure_aips(datasets)))
    }

    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining> {
        self.begin(Activity::Training)?;
        self.observer.trained(self.agents.steps);
        let training = self.work(|worker, _, observer| worker.train_policies(period, observer))?;
        self.agents = self.worker.state();
        Ok(training)
    }

    fn average_policies(&mut self) -> Result<()> {
        average(&mut self.agents, self.domain.kinds());
        self.work(|worker, agents, _| worker.restore(agents));
        Ok(())
    }

    fn take_load(&mut self) -> FleetLoad {
        self.timesheet.add(&Timesheet::of_cpu(self.clock.lap()));
        let worker = WorkerLoad { timesheet: self.timesheet.take(), footprint: footprint() };
        FleetLoad { workers: vec![worker], at_work: std::mem::take(&mut self.at_work), ..FleetLoad::default() }
    }
}
