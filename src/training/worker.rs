//! A worker: a share of the agents for the whole run, with everything that belongs to them.
//!
//! Policies, AIPs and optimisers live here; local simulators only for the length of a period, because libsumo holds
//! one simulation per process and the worker serves the GS in between. Every period begins with fresh episodes and
//! with streams of its own, so nothing but parameters and moments has to survive it.

use std::sync::Arc;

use super::collect::collect_episode;
use super::environment::Environment;
use super::fleet::{AgentTraining, AipTraining, Observer, PolicyTraining};
use super::global::GlobalEnvironment;
use super::ials::Ials;
use super::ppo::{self, Decayed, Losses};
use super::rollout::{EpisodeReturns, roll_out};
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
        }
    }

    pub fn policies(&self) -> JointPolicy {
        self.policies.joint_policy()
    }

    /// Algorithm 2 for some of a period's episodes: the datasets of *all* agents, in the order of the episodes.
    pub fn collect(
        &self,
        policies: &JointPolicy,
        period: &Period,
        episodes: std::ops::Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<Dataset>> {
        let mut simulator = self.domain.global_simulator()?;
        let mut controller = self.controller(policies);
        let mut datasets = vec![Dataset::new(self.domain.spec()); self.domain.agents()];
        let seed = self.run.fork("collection").for_period(period.index);
        for (done, episode) in episodes.clone().enumerate() {
            collect_episode(&mut *simulator, &mut controller, seed.for_episode(episode), &mut datasets)?;
            observer.busy(Phase::Collection, (done + 1) as f64 / episodes.len() as f64);
        }
        Ok(datasets)
    }

    /// Plays some of the evaluation episodes.
    pub fn evaluate(
        &self,
        policies: &JointPolicy,
        episodes: std::ops::Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<EpisodeReport>> {
        let mut simulator = self.domain.global_simulator()?;
        let mut controller = self.controller(policies);
        let mut reports = Vec::with_capacity(episodes.len());
        for (done, episode) in episodes.clone().enumerate() {
            reports.push(play(&mut *simulator, &mut controller, episode_seed(self.run, episode))?);
            observer.busy(Phase::Evaluation, (done + 1) as f64 / episodes.len() as f64);
        }
        Ok(reports)
    }

    /// Trains the AIPs of this worker's agents; `datasets`: theirs.
    pub fn train_aips(&mut self, datasets: &[Dataset], period: &Period, observer: &dyn Observer) -> AipTraining {
        let seed = self.run.fork("aip minibatches").for_period(period.index);
        let mut watch = Stopwatch::default();
        let losses = watch.time(Phase::AipTraining, || {
            let progress = &mut |share| observer.busy(Phase::AipTraining, share);
            train(&mut self.aips, &self.agents, datasets, &self.config.aip, seed, progress)
        });
        AipTraining { losses, parameters: self.aips.parameters().to_rows(), watch }
    }

    /// Trains the policies until the end of the period (Algorithm 1, lines 7 to 12).
    pub fn train_policies(&mut self, period: &Period, observer: &dyn Observer) -> Result<PolicyTraining> {
        let copies = self.config.copies();
        let stream = |purpose: &str| self.run.fork(purpose).for_period(period.index);
        let (acting, influences) =
            (self.row_dice(stream("acting"), copies), self.row_dice(stream("influence"), copies));
        let mut minibatches: Vec<Dice> =
            self.agents.iter().map(|&agent| stream("policy minibatches").for_agent(agent).dice()).collect();
        let (domain, stagger) = (self.domain.clone(), self.config.local_simulators.stagger);
        let (episodes, horizon) = (stream("training episodes"), domain.spec().horizon);
        match self.config.simulator {
            SimulatorKind::Gs => {
                let mut gs = GlobalEnvironment::begin(domain.global_simulator()?, episodes)?;
                let updater =
                    Updater { policies: &mut self.policies, adam: &mut self.adam, config: &self.config, horizon };
                updater.run(&mut gs, &mut self.steps, period, acting, &mut minibatches, observer)
            }
            SimulatorKind::Dials | SimulatorKind::UntrainedDials => {
                let simulators = domain.local_simulator(&self.agents, copies, episodes)?;
                let mut ials = Ials::begin(simulators, &mut self.aips, influences, copies, stagger)?;
                let updater =
                    Updater { policies: &mut self.policies, adam: &mut self.adam, config: &self.config, horizon };
                let mut training =
                    updater.run(&mut ials, &mut self.steps, period, acting, &mut minibatches, observer)?;
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
struct Updater<'a> {
    policies: &'a mut PolicyStack,
    adam: &'a mut Adam,
    config: &'a Config,
    horizon: usize,
}

impl Updater<'_> {
    /// Rollouts and updates in turn, until `steps` reaches the end of the period: its first multiple of the memory.
    fn run(
        self,
        environment: &mut dyn Environment,
        steps: &mut u64,
        period: &Period,
        mut acting: Vec<Dice>,
        minibatches: &mut [Dice],
        observer: &dyn Observer,
    ) -> Result<PolicyTraining> {
        let (ppo, agents) = (&self.config.ppo, self.policies.agents());
        let copies = environment.rows() / agents;
        let (obs_dim, slots_per_rollout) = (environment.percept().obs.width(), ppo.rollout_steps * copies);
        let mut memory = Memory::new(agents, ppo.memory, obs_dim);
        let mut returns = EpisodeReturns::new(agents, copies, self.horizon);
        let mut losses = vec![Losses::default(); agents];
        let mut watch = Stopwatch::default();
        let updates = period.end.saturating_sub(*steps).div_ceil(ppo.memory as u64);
        for _ in 0..updates {
            for slot in (0..ppo.memory).step_by(slots_per_rollout) {
                roll_out(environment, self.policies, &mut memory, slot, &mut acting, ppo, &mut returns, &mut watch)?;
            }
            let decayed = Decayed::at(ppo, *steps as f64 / self.config.total_steps as f64);
            let of_update = watch
                .time(Phase::Learning, || ppo::update(self.policies, self.adam, &memory, minibatches, ppo, decayed));
            losses.iter_mut().zip(&of_update).for_each(|(mean, of_update)| mean.add(of_update, 1.0 / updates as f64));
            *steps += ppo.memory as u64;
            observer.trained(*steps);
        }
        let agents = returns.means().into_iter().zip(losses);
        let agents = agents.map(|((mean_return, episodes), losses)| AgentTraining { mean_return, episodes, losses });
        Ok(PolicyTraining {
            steps: *steps,
            policies: self.policies.joint_policy(),
            agents: agents.collect(),
            counters: Vec::new(),
            watch,
        })
    }
}
