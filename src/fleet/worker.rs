//! A worker: a share of the agents for the whole run, with everything that belongs to them.
//!
//! Policies, AIPs and optimisers live in its [`AgentBlock`]s; local simulators only for the length of a period, because
//! libsumo holds one simulation per process and the worker serves the GS in between. A period begins where
//! [`AgentsState`] left the one before it, down to the cars on the road.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use crate::base::{Activity, AgentId, Phase, Rows, Seed, Stopwatch, Timesheet};
use crate::config::{Config, Period};
use crate::domain::{Controller, Domain, GlobalSimulator, Result};
use crate::evaluation::{EpisodeReport, episode_seed, play};
use crate::influence::{AipLoss, Dataset, FreshLoss};
use crate::nn::Threads;
use crate::policy::{JointPolicy, JointPolicyController, PolicyStack, Selection};
use crate::training::answers::PolicyTraining;
use crate::training::block::{AgentBlock, agents_per_block};
use crate::training::collect::{Purpose, collect_episode};
use crate::training::observer::Observer;
use crate::training::state::AgentsState;
use crate::training::timed::{Timed, TimedController};

pub struct Worker {
    domain: Arc<dyn Domain>,
    config: Config,
    blocks: Vec<AgentBlock>,
    timesheet: Timesheet,
}

impl Worker {
    /// `threads`: for the policies while they train.
    pub fn new(domain: Arc<dyn Domain>, config: &Config, agents: Vec<AgentId>, threads: &Threads) -> Self {
        let per_block = agents_per_block(config).min(agents.len().max(1));
        let block = |agents: &[AgentId]| AgentBlock::new(domain.clone(), config, agents, threads.clone());
        Worker {
            blocks: agents.chunks(per_block).map(block).collect(),
            config: config.clone(),
            domain,
            timesheet: Timesheet::default(),
        }
    }

    /// What its agents have become.
    pub fn state(&self) -> AgentsState {
        AgentsState::joined(self.blocks.iter().map(AgentBlock::state).collect())
    }

    /// Goes on from a state of the same agents.
    pub fn restore(&mut self, state: &AgentsState) {
        let mut first = 0;
        for block in &mut self.blocks {
            block.restore(state.share(first..first + block.agents()));
            first += block.agents();
        }
    }

    /// The time spent since the last call.
    pub fn take_timesheet(&mut self) -> Timesheet {
        self.timesheet.take()
    }

    /// Algorithm 2 for some of the episodes: the datasets of *all* agents, in the order of the episodes.
    pub fn collect(
        &mut self,
        policies: &JointPolicy,
        purpose: Purpose,
        episodes: Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<Dataset>> {
        let seed = purpose.stream(&self.config);
        let mut datasets = vec![Dataset::new(self.domain.spec()); self.domain.agents()];
        let activity = purpose.activity(&self.config);
        self.on_the_gs(activity, policies, |simulator, controller| {
            for (done, episode) in episodes.clone().enumerate() {
                collect_episode(simulator, controller, seed.for_episode(episode), &mut datasets)?;
                observer.busy(activity, (done + 1) as f64 / episodes.len() as f64);
            }
            Ok(())
        })?;
        Ok(datasets)
    }

    /// Plays some of the evaluation episodes.
    pub fn evaluate(
        &mut self,
        policies: &JointPolicy,
        episodes: Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<EpisodeReport>> {
        let seed = Seed::new(self.config.evaluation.seed);
        let mut reports = Vec::with_capacity(episodes.len());
        self.on_the_gs(Activity::Evaluation, policies, |simulator, controller| {
            for (done, episode) in episodes.clone().enumerate() {
                reports.push(play(simulator, controller, episode_seed(seed, episode))?);
                observer.busy(Activity::Evaluation, (done + 1) as f64 / episodes.len() as f64);
            }
            Ok(())
        })?;
        Ok(reports)
    }

    /// Trains the AIPs of this worker's agents; `datasets`: theirs.
    pub fn train_aips(&mut self, datasets: &[Dataset], period: &Period, observer: &dyn Observer) -> Vec<AipLoss> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let count = self.blocks.len() as f64;
        let mut rest = datasets;
        let mut losses = Vec::new();
        for (done, block) in self.blocks.iter_mut().enumerate() {
            let (theirs, others) = rest.split_at(block.agents());
            rest = others;
            let progress = &mut |share| observer.busy(Activity::AipTraining, (done as f64 + share) / count);
            losses.extend(block.train_aips(theirs, period, &mut watch, progress));
        }
        self.timesheet.note(Activity::AipTraining, begun.elapsed(), &watch);
        losses
    }

    /// The loss of the AIPs of this worker's agents; `datasets`: theirs.
    pub fn measure_aips(&mut self, datasets: &[Dataset]) -> Vec<FreshLoss> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let mut rest = datasets;
        let mut losses = Vec::new();
        for block in &self.blocks {
            let (theirs, others) = rest.split_at(block.agents());
            rest = others;
            losses.extend(block.measure_aips(theirs, &mut watch));
        }
        self.timesheet.note(Purpose::Measuring.activity(&self.config), begun.elapsed(), &watch);
        losses
    }

    /// What the influence predictors of its agents have learnt, one row each.
    pub fn aips(&self) -> Rows<f32> {
        let join = |mut all: Rows<f32>, next: Rows<f32>| {
            all.extend(&next);
            all
        };
        self.blocks.iter().map(AgentBlock::aips).reduce(join).unwrap_or_else(|| Rows::new(0, 1))
    }

    /// Trains the policies of its agents until the end of the period, block after block.
    pub fn train_policies(&mut self, period: &Period, observer: &dyn Observer) -> Result<PolicyTraining> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let count = self.blocks.len() as u64;
        let mut parts = Vec::new();
        for (done, block) in (0..).zip(&mut self.blocks) {
            // As far as all agents are on average.
            let average = |steps| (done * period.end + steps + (count - done - 1) * period.start) / count;
            let progress = &mut |steps| observer.trained(average(steps));
            parts.push(block.train_policies(period, &mut watch, progress)?);
        }
        self.timesheet.note(Activity::Training, begun.elapsed(), &watch);
        Ok(PolicyTraining::joined(parts))
    }

    /// Lets all agents' policies act on the GS, in episodes that `play` plays.
    fn on_the_gs(
        &mut self,
        activity: Activity,
        policies: &JointPolicy,
        play: impl FnOnce(&mut dyn GlobalSimulator, &mut dyn Controller) -> Result<()>,
    ) -> Result<()> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let mut simulator = Timed::new(watch.time(Phase::Loading, || self.domain.global_simulator())?);
        let everybody = PolicyStack::blank(self.domain.agents(), self.domain.spec(), &self.config.policy);
        let mut controller = TimedController::new(JointPolicyController::new(everybody, policies, Selection::Sampled));
        play(&mut simulator, &mut controller)?;
        watch.add(&simulator.take_watch());
        watch.add(&controller.watch);
        drop(simulator);
        self.timesheet.note(activity, begun.elapsed(), &watch);
        Ok(())
    }
}
