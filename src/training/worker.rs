//! A worker: a share of the agents for the whole run, with everything that belongs to them.
//!
//! Policies, AIPs and optimisers live in its [`AgentBlock`]s; local simulators only for the length of a period, because
//! libsumo holds one simulation per process and the worker serves the GS in between. Every period begins with fresh
//! episodes and with streams of its own, so nothing but [`AgentsState`] has to survive it.

use std::ops::Range;
use std::sync::Arc;

use super::answers::PolicyTraining;
use super::block::{AgentBlock, agents_per_block};
use super::collect::{Purpose, collect_episode};
use super::observer::Observer;
use super::state::AgentsState;
use crate::base::{AgentId, Phase, Rows, Seed, Stopwatch};
use crate::config::{Config, Period};
use crate::domain::{Domain, Result};
use crate::evaluation::{EpisodeReport, episode_seed, play};
use crate::influence::{AipLoss, Dataset, FreshLoss};
use crate::policy::{JointPolicy, JointPolicyController, PolicyStack, Selection};

pub struct Worker {
    domain: Arc<dyn Domain>,
    config: Config,
    blocks: Vec<AgentBlock>,
    run: Seed,
    watch: Stopwatch,
}

impl Worker {
    pub fn new(domain: Arc<dyn Domain>, config: &Config, agents: Vec<AgentId>) -> Self {
        let per_block = agents_per_block(config).min(agents.len().max(1));
        Worker {
            blocks: agents.chunks(per_block).map(|agents| AgentBlock::new(domain.clone(), config, agents)).collect(),
            run: Seed::new(config.seed),
            config: config.clone(),
            domain,
            watch: Stopwatch::default(),
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

    /// The time spent in each phase since the last call.
    pub fn take_watch(&mut self) -> Stopwatch {
        self.watch.take()
    }

    /// Algorithm 2 for some of the episodes: the datasets of *all* agents, in the order of the episodes.
    pub fn collect(
        &mut self,
        policies: &JointPolicy,
        purpose: Purpose,
        episodes: Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<Dataset>> {
        let mut watch = Stopwatch::default();
        let datasets = watch.time(purpose.phase(), || {
            let mut simulator = self.domain.global_simulator()?;
            let mut controller = self.controller(policies);
            let mut datasets = vec![Dataset::new(self.domain.spec()); self.domain.agents()];
            let seed = purpose.stream(self.run);
            for (done, episode) in episodes.clone().enumerate() {
                collect_episode(&mut *simulator, &mut controller, seed.for_episode(episode), &mut datasets)?;
                observer.busy(purpose.phase(), (done + 1) as f64 / episodes.len() as f64);
            }
            Ok(datasets)
        });
        self.watch.add(&watch);
        datasets
    }

    /// Plays some of the evaluation episodes.
    pub fn evaluate(
        &mut self,
        policies: &JointPolicy,
        episodes: Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<EpisodeReport>> {
        let mut watch = Stopwatch::default();
        let reports = watch.time(Phase::Evaluation, || {
            let mut simulator = self.domain.global_simulator()?;
            let mut controller = self.controller(policies);
            let mut reports = Vec::with_capacity(episodes.len());
            for (done, episode) in episodes.clone().enumerate() {
                reports.push(play(&mut *simulator, &mut controller, episode_seed(self.run, episode))?);
                observer.busy(Phase::Evaluation, (done + 1) as f64 / episodes.len() as f64);
            }
            Ok(reports)
        });
        self.watch.add(&watch);
        reports
    }

    /// Trains the AIPs of this worker's agents; `datasets`: theirs.
    pub fn train_aips(&mut self, datasets: &[Dataset], period: &Period, observer: &dyn Observer) -> Vec<AipLoss> {
        let count = self.blocks.len() as f64;
        let mut rest = datasets;
        let mut losses = Vec::new();
        for (done, block) in self.blocks.iter_mut().enumerate() {
            let (theirs, others) = rest.split_at(block.agents());
            rest = others;
            let progress = &mut |share| observer.busy(Phase::AipTraining, (done as f64 + share) / count);
            losses.extend(block.train_aips(theirs, period, &mut self.watch, progress));
        }
        losses
    }

    /// The loss of the AIPs of this worker's agents; `datasets`: theirs.
    pub fn measure_aips(&mut self, datasets: &[Dataset]) -> Vec<FreshLoss> {
        let mut rest = datasets;
        let mut losses = Vec::new();
        for block in &self.blocks {
            let (theirs, others) = rest.split_at(block.agents());
            rest = others;
            losses.extend(self.watch.time(Phase::Evaluation, || block.measure_aips(theirs)));
        }
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
        let count = self.blocks.len() as u64;
        let mut parts = Vec::new();
        for (done, block) in (0..).zip(&mut self.blocks) {
            // As far as all agents are on average.
            let average = |steps| (done * period.end + steps + (count - done - 1) * period.start) / count;
            let progress = &mut |steps| observer.trained(average(steps));
            parts.push(block.train_policies(period, &mut self.watch, progress)?);
        }
        Ok(PolicyTraining::joined(parts))
    }

    /// All agents' policies, ready to act.
    fn controller(&self, policies: &JointPolicy) -> JointPolicyController {
        let everybody = PolicyStack::blank(self.domain.agents(), self.domain.spec(), &self.config.policy);
        JointPolicyController::new(everybody, policies, Selection::Sampled)
    }
}
