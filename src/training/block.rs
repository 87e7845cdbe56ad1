//! A block of agents that are trained together, on one stack of networks and one forest of local simulators.
//!
//! A worker trains its blocks one after the other, each for the whole period: between two exchanges agents know nothing
//! of each other, so the order changes no number, and networks and cars of a few agents stay in the cache where those of
//! a hundred do not.

use std::sync::Arc;

use super::answers::{AgentTraining, PolicyTraining};
use super::environment::Environment;
use super::global::GlobalEnvironment;
use super::ials::Ials;
use super::ppo::{self, Decayed, Losses};
use super::rollout::{Actor, roll_out};
use super::state::AgentsState;
use super::stream::AgentStream;
use crate::base::{AgentId, Dice, Phase, RandomPurpose, Rows, Seed, Stopwatch};
use crate::config::{Config, Period, Simulator};
use crate::domain::{Domain, Result};
use crate::influence::{AipLoss, Dataset, FreshLoss, TrainablePredictor, initial_predictor, measure, train};
use crate::nn::{Adam, Threads};
use crate::policy::{Memory, PolicyStack};

/// Local simulators per block. The cars of a larger forest leave the cache between two steps: measured on traffic, SUMO
/// costs the same per intersection with 8 and 16, 10 % more with 32, 15 % more with 64 and 60 % more with 128.
const ROWS_PER_BLOCK: usize = 16;

/// Everything that belongs to some agents for the whole run.
pub struct AgentBlock {
    domain: Arc<dyn Domain>,
    config: Config,
    agents: Vec<AgentId>,
    policies: PolicyStack,
    adam: Adam,
    predictor: Box<dyn TrainablePredictor>,
    /// Timesteps per agent so far.
    steps: u64,
    /// One per agent.
    streams: Vec<AgentStream>,
}

/// The policies of `agents` as a run with this config begins.
pub fn initial_policies(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> PolicyStack {
    let seed = Seed::new(config.seed).fork(RandomPurpose::Policy);
    PolicyStack::new(agents, domain.spec(), &config.policy, &domain.initial_action_bias(), seed)
}

/// The influence predictors of `agents` as a run with this config begins.
pub fn initial_aips(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> Box<dyn TrainablePredictor> {
    let seed = Seed::new(config.seed).fork(RandomPurpose::Aip);
    initial_predictor(config.predictor(), agents, domain.spec(), &config.aip, seed)
}

/// Agents per block. On the GS all agents act in one simulation, so they are one block.
pub fn agents_per_block(config: &Config) -> usize {
    if config.simulator == Simulator::Global { usize::MAX } else { (ROWS_PER_BLOCK / config.copies()).max(1) }
}

impl AgentBlock {
    pub fn new(domain: Arc<dyn Domain>, config: &Config, agents: &[AgentId], threads: Threads) -> Self {
        let mut policies = initial_policies(&*domain, config, agents);
        policies.use_threads(threads);
        AgentBlock {
            adam: Adam::new(policies.parameters()),
            predictor: initial_aips(&*domain, config, agents),
            streams: agents.iter().map(|&agent| AgentStream::begin(config, &policies, agent)).collect(),
            policies,
            agents: agents.to_vec(),
            steps: 0,
            config: config.clone(),
            domain,
        }
    }

    pub fn agents(&self) -> usize {
        self.agents.len()
    }

    /// What its agents have become.
    pub fn state(&self) -> AgentsState {
        AgentsState {
            steps: self.steps,
            policies: self.policies.joint_policy(),
            moments: self.adam.moments().clone(),
            aips: self.predictor.values(),
            streams: self.streams.clone(),
        }
    }

    /// Goes on from a state of the same agents.
    pub fn restore(&mut self, state: AgentsState) {
        self.steps = state.steps;
        self.streams = state.streams;
        self.policies.load(&state.policies);
        self.adam.restore(state.moments);
        self.predictor.load(&state.aips);
    }

    /// Trains the influence predictors; `datasets`: one per agent. `progress` is called with the share that is done.
    pub fn train_aips(
        &mut self,
        datasets: &[Dataset],
        period: &Period,
        watch: &mut Stopwatch,
        progress: &mut dyn FnMut(f64),
    ) -> Vec<AipLoss> {
        let seed = Seed::new(self.config.seed).fork(RandomPurpose::AipMinibatches).for_steps(period.start);
        train(&mut *self.predictor, &self.agents, datasets, &self.config.aip, seed, watch, progress)
    }

    /// Measures the loss of the influence predictors; `datasets`: one per agent.
    pub fn measure_aips(&self, datasets: &[Dataset], watch: &mut Stopwatch) -> Vec<FreshLoss> {
        measure(&*self.predictor, datasets, watch)
    }

    /// What its influence predictors have learnt, one row per agent.
    pub fn aips(&self) -> Rows<f32> {
        self.predictor.values()
    }

    /// Trains the policies until the end of the period (Algorithm 1, lines 7 to 12). `progress` is called with the
    /// timesteps so far.
    pub fn train_policies(
        &mut self,
        period: &Period,
        watch: &mut Stopwatch,
        progress: &mut dyn FnMut(u64),
    ) -> Result<PolicyTraining> {
        let (domain, episodes) =
            (self.domain.clone(), Seed::new(self.config.seed).fork(RandomPurpose::TrainingEpisodes));
        let learner = Learner {
            policies: &mut self.policies,
            adam: &mut self.adam,
            steps: &mut self.steps,
            streams: &mut self.streams,
            config: &self.config,
            horizon: domain.spec().horizon,
            watch,
        };
        match self.config.simulator {
            Simulator::Global => {
                let simulator = learner.watch.time(Phase::Loading, || domain.global_simulator())?;
                let resume = || GlobalEnvironment::resume(simulator, episodes, learner.streams);
                let mut gs = learner.watch.time(Phase::Retracing, resume)?;
                learner.learn(&mut gs, period, progress)
            }
            Simulator::Local(_) => {
                let make = || domain.local_simulator(&self.agents, self.config.copies(), episodes);
                let simulators = learner.watch.time(Phase::Loading, make)?;
                let stagger = self.config.local_simulators.stagger;
                let resume = || Ials::resume(simulators, &mut *self.predictor, learner.streams, stagger);
                let mut ials = learner.watch.time(Phase::Retracing, resume)?;
                let mut training = learner.learn(&mut ials, period, progress)?;
                training.counters = ials.counters().into_iter().map(|(name, count)| (name.to_owned(), count)).collect();
                Ok(training)
            }
        }
    }
}

/// What PPO changes and what it goes by.
struct Learner<'a> {
    policies: &'a mut PolicyStack,
    adam: &'a mut Adam,
    steps: &'a mut u64,
    streams: &'a mut [AgentStream],
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
        progress: &mut dyn FnMut(u64),
    ) -> Result<PolicyTraining> {
        let Learner { policies, adam, steps, streams, config, horizon, watch } = self;
        let (ppo, agents) = (&config.ppo, policies.agents());
        let copies = environment.rows() / agents;
        let obs_dim = environment.percept().obs.width();
        let state_width = config.policy.recurrent.unwrap_or(0);
        let mut memory = Memory::new(agents, ppo.memory, config.sequence_length(), obs_dim, state_width);
        let mut actor = Actor::resume(policies, streams, horizon);
        let mut minibatches: Vec<Dice> = streams.iter().map(|stream| stream.minibatches.clone()).collect();
        let mut losses = vec![Losses::default(); agents];
        let updates = period.end.saturating_sub(*steps).div_ceil(ppo.memory as u64);
        let mut decayed = Decayed::at(ppo, *steps as f64 / config.total_steps as f64);
        for _ in 0..updates {
            for slot in (0..ppo.memory).step_by(ppo.rollout_steps * copies) {
                roll_out(environment, policies, &mut actor, &mut memory, slot, ppo, watch)?;
            }
            decayed = Decayed::at(ppo, *steps as f64 / config.total_steps as f64);
            let of_update = ppo::update(policies, adam, &memory, &mut minibatches, ppo, decayed, watch);
            losses.iter_mut().zip(&of_update).for_each(|(mean, of_update)| mean.add(of_update, 1.0 / updates as f64));
            *steps += ppo.memory as u64;
            progress(*steps);
        }
        environment.leave(streams);
        actor.leave(streams);
        streams.iter_mut().zip(minibatches).for_each(|(stream, dice)| stream.minibatches = dice);
        let agents = actor.returns.means().into_iter().zip(losses);
        let agents = agents.map(|((mean_return, episodes), losses)| AgentTraining { mean_return, episodes, losses });
        Ok(PolicyTraining { agents: agents.collect(), counters: Vec::new(), decayed })
    }
}
