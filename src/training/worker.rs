//! A worker: a share of the agents for the whole run, with everything that belongs to them.
//!
//! Policies, AIPs and optimisers live here; local simulators only for the length of a period, because libsumo holds
//! one simulation per process and the worker serves the GS in between. Every period begins with fresh episodes and
//! with streams of its own, so nothing but [`AgentsState`] has to survive it.

use std::ops::Range;
use std::sync::Arc;

use super::collect::collect_episode;
use super::environment::Environment;
use super::fleet::{AgentTraining, AipTraining, PolicyTraining};
use super::global::GlobalEnvironment;
use super::ials::Ials;
use super::observer::Observer;
use super::ppo::{self, Decayed, Losses};
use super::rollout::{EpisodeReturns, roll_out};
use super::state::AgentsState;
use crate::base::{AgentId, Dice, Phase, Seed, Stopwatch};
use crate::config::{Config, Period, SimulatorKind};
use crate::domain::{Domain, Result};
use crate::evaluation::{EpisodeReport, episode_seed, play};
use crate::influence::{AipStack, Dataset, train};
use crate::nn::Adam;
use crate::policy::{JointPolicy, JointPolicyController, Memory, PolicyStack, Selection};

pub struct Worker {
    domain: Arc<dyn Domain>,
    config: Config,
    agents: Vec<AgentId>,
    policies: PolicyStack,
    adam: Adam,
    aips: AipStack,
    /// Timesteps per agent so far.
    steps: u64,
    run: Seed,
    watch: Stopwatch,
}

/// The policies of `agents` as a run with this config begins.
pub fn initial_policies(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> PolicyStack {
    let seed = Seed::new(config.seed).fork("policy");
    PolicyStack::new(agents, domain.spec(), &config.policy.hidden, &domain.initial_action_bias(), seed)
}

/// The AIPs of `agents` as a run with this config begins.
pub fn initial_aips(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> AipStack {
    AipStack::new(agents, domain.spec(), &config.aip.hidden, Seed::new(config.seed).fork("aip"))
}

impl Worker {
    pub fn new(domain: Arc<dyn Domain>, config: &Config, agents: Vec<AgentId>) -> Self {
        let policies = initial_policies(&*domain, config, &agents);
        Worker {
            adam: Adam::new(policies.parameters()),
            aips: initial_aips(&*domain, config, &agents),
            policies,
            agents,
            steps: 0,
            run: Seed::new(config.seed),
            config: config.clone(),
            domain,
            watch: Stopwatch::default(),
        }
    }

    /// What its agents have become.
    pub fn state(&self) -> AgentsState {
        AgentsState {
            steps: self.steps,
            policies: self.policies.joint_policy(),
            moments: self.adam.moments().clone(),
            aips: self.aips.parameters().to_rows(),
        }
    }

    /// Goes on from a state of the same agents.
    pub fn restore(&mut self, state: AgentsState) {
        self.steps = state.steps;
        self.policies.load(&state.policies);
        self.adam.restore(state.moments);
        self.aips.load(&state.aips);
    }

    /// The time spent in each phase since the last call.
    pub fn take_watch(&mut self) -> Stopwatch {
        self.watch.take()
    }

    /// Algorithm 2 for some of a period's episodes: the datasets of *all* agents, in the order of the episodes.
    pub fn collect(
        &mut self,
        policies: &JointPolicy,
        period: &Period,
        episodes: Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<Dataset>> {
        let mut watch = Stopwatch::default();
        let datasets = watch.time(Phase::Collection, || {
            let mut simulator = self.domain.global_simulator()?;
            let mut controller = self.controller(policies);
            let mut datasets = vec![Dataset::new(self.domain.spec()); self.domain.agents()];
            let seed = self.run.fork("collection").for_period(period.index);
            for (done, episode) in episodes.clone().enumerate() {
                collect_episode(&mut *simulator, &mut controller, seed.for_episode(episode), &mut datasets)?;
                observer.busy(Phase::Collection, (done + 1) as f64 / episodes.len() as f64);
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
    pub fn train_aips(&mut self, datasets: &[Dataset], period: &Period, observer: &dyn Observer) -> AipTraining {
        let seed = self.run.fork("aip minibatches").for_period(period.index);
        let losses = self.watch.time(Phase::AipTraining, || {
            let progress = &mut |share| observer.busy(Phase::AipTraining, share);
            train(&mut self.aips, &self.agents, datasets, &self.config.aip, seed, progress)
        });
        AipTraining { losses, parameters: self.aips.parameters().to_rows() }
    }

    /// Trains the policies until the end of the period (Algorithm 1, lines 7 to 12).
    pub fn train_policies(&mut self, period: &Period, observer: &dyn Observer) -> Result<PolicyTraining> {
        let copies = self.config.copies();
        let stream = |purpose: &str| self.run.fork(purpose).for_period(period.index);
        let acting = self.row_dice(stream("acting"), copies);
        let influences = self.row_dice(stream("influence"), copies);
        let minibatches = self.agents.iter().map(|&agent| stream("policy minibatches").for_agent(agent).dice());
        let minibatches: Vec<Dice> = minibatches.collect();
        let (domain, episodes) = (self.domain.clone(), stream("training episodes"));
        let learner = Learner {
            policies: &mut self.policies,
            adam: &mut self.adam,
            steps: &mut self.steps,
            config: &self.config,
            horizon: domain.spec().horizon,
            watch: &mut self.watch,
        };
        match self.config.simulator {
            SimulatorKind::Gs => {
                let mut gs = GlobalEnvironment::begin(domain.global_simulator()?, episodes)?;
                learner.learn(&mut gs, period, acting, minibatches, observer)
            }
            SimulatorKind::Dials | SimulatorKind::UntrainedDials => {
                let simulators = domain.local_simulator(&self.agents, copies, episodes)?;
                let stagger = self.config.local_simulators.stagger;
                let mut ials = Ials::begin(simulators, &mut self.aips, influences, copies, stagger)?;
                let mut training = learner.learn(&mut ials, period, acting, minibatches, observer)?;
                training.counters = ials.counters().into_iter().map(|(name, count)| (name.to_owned(), count)).collect();
                Ok(training)
            }
        }
    }

    fn controller(&self, policies: &JointPolicy) -> JointPolicyController {
        let everybody = initial_policies(&*self.domain, &self.config, &AgentId::all(self.domain.agents()));
        JointPolicyController::new(everybody, policies, Selection::Sampled)
    }

    /// One stream per (agent, copy).
    fn row_dice(&self, seed: Seed, copies: usize) -> Vec<Dice> {
        let of_agent = |&agent: &AgentId| (0..copies).map(move |copy| seed.for_agent(agent).for_copy(copy).dice());
        self.agents.iter().flat_map(of_agent).collect()
    }
}

/// What PPO changes and what it goes by.
struct Learner<'a> {
    policies: &'a mut PolicyStack,
    adam: &'a mut Adam,
    steps: &'a mut u64,
    config: &'a Config,
    horizon: usize,
    watch: &'a mut Stopwatch,
}

impl Learner<'_> {
    /// Rollouts and updates in turn, until the steps reach the end of the period: its first multiple of the memory.
    fn learn(
        self,
        environment: &mut dyn Environment,
        period: &Period,
        mut acting: Vec<Dice>,
        mut minibatches: Vec<Dice>,
        observer: &dyn Observer,
    ) -> Result<PolicyTraining> {
        let Learner { policies, adam, steps, config, horizon, watch } = self;
        let (ppo, agents) = (&config.ppo, policies.agents());
        let copies = environment.rows() / agents;
        let mut memory = Memory::new(agents, ppo.memory, environment.percept().obs.width());
        let mut returns = EpisodeReturns::new(agents, copies, horizon);
        let mut losses = vec![Losses::default(); agents];
        let updates = period.end.saturating_sub(*steps).div_ceil(ppo.memory as u64);
        let mut decayed = Decayed::at(ppo, *steps as f64 / config.total_steps as f64);
        for _ in 0..updates {
            for slot in (0..ppo.memory).step_by(ppo.rollout_steps * copies) {
                roll_out(environment, policies, &mut memory, slot, &mut acting, ppo, &mut returns, watch)?;
            }
            decayed = Decayed::at(ppo, *steps as f64 / config.total_steps as f64);
            let of_update =
                watch.time(Phase::Learning, || ppo::update(policies, adam, &memory, &mut minibatches, ppo, decayed));
            losses.iter_mut().zip(&of_update).for_each(|(mean, of_update)| mean.add(of_update, 1.0 / updates as f64));
            *steps += ppo.memory as u64;
            observer.trained(*steps);
        }
        let agents = returns.means().into_iter().zip(losses);
        let agents = agents.map(|((mean_return, episodes), losses)| AgentTraining { mean_return, episodes, losses });
        Ok(PolicyTraining { agents: agents.collect(), counters: Vec::new(), decayed })
    }
}
