//! A block: agents of one kind that are trained together, on one stack of networks and one forest of local simulators.
//!
//! A worker trains its blocks one after the other, each for the whole period. Between two exchanges agents know nothing
//! of each other, so the order changes no number. The networks and cars of a few agents stay in the cache; those of a
//! hundred do not. On the global simulator (GS) all blocks act in one simulation, one block per kind.

use std::sync::Arc;

use super::answers::{AgentTraining, PolicyTraining};
use super::environment::Environment;
use super::global::GlobalEnvironment;
use super::ials::Ials;
use super::imitation::{ImitationLoss, imitate};
use super::ppo::{self, Decayed, Learns, Settings};
use super::ppo_loss::Losses;
use super::rollout::{Actor, KindAtPlay, roll_out};
use super::state::{AgentsState, JointMoments};
use super::stream::AgentStream;
use crate::config::{Config, Period, Simulator};
use crate::influence::{AipLoss, Dataset, FreshLoss, TrainablePredictor, initial_predictor, measure, train};
use crate::policy::{Demonstrations, JointPolicy, Memory, PolicyStack};
use dials_core::base::{AgentId, Dice, Phase, Ragged, RandomPurpose, Seed, Stopwatch, Work};
use dials_core::domain::{Domain, RegionSpec, Result};
use stacknets::{Adam, Moments, Threads};

/// Number of local simulators per block. The cars of a larger forest leave the cache between two steps. Measured on
/// traffic, SUMO costs the same per intersection with 8 and 16, 10 % more with 32, 15 % more with 64 and 60 % more with
/// 128.
const ROWS_PER_BLOCK: usize = 16;

/// All that belongs to some agents of one kind during the whole run.
pub struct AgentBlock {
    domain: Arc<dyn Domain>,
    config: Config,
    agents: Vec<AgentId>,
    learner: KindLearner,
    predictor: Box<dyn TrainablePredictor>,
}

/// The part that PPO changes.
struct KindLearner {
    spec: RegionSpec,
    policies: PolicyStack,
    adam: Adam,
    /// Timesteps per agent so far.
    steps: u64,
    /// One stream per agent.
    streams: Vec<AgentStream>,
}

/// Makes the first policies of `agents`, which are of one kind.
///
/// DEVIATION 21: every agent has weights of its own. In the authors' code all agents begin with the same.
pub fn initial_policies(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> PolicyStack {
    let seed = Seed::new(config.seed).fork(RandomPurpose::Policy);
    let kind = domain.kinds().of(agents[0]);
    let alike = config.begins_with_one_policy().then(|| vec![kind.agents[0]; agents.len()]);
    let agents = alike.as_deref().unwrap_or(agents);
    PolicyStack::new(agents, &kind.spec, &config.policy, &domain.initial_action_bias(kind), seed)
}

/// Makes the first influence predictors of `agents`, which are of one kind.
pub fn initial_aips(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> Box<dyn TrainablePredictor> {
    let seed = Seed::new(config.seed).fork(RandomPurpose::Aip);
    let spec = &domain.kinds().of(agents[0]).spec;
    initial_predictor(config.predictor(), agents, spec, &config.aip, seed)
}

/// Returns the number of agents per block. On the GS all agents act in one simulation, so there is one block per kind.
pub fn agents_per_block(config: &Config) -> usize {
    if config.simulator == Simulator::Global { usize::MAX } else { (ROWS_PER_BLOCK / config.copies()).max(1) }
}

impl AgentBlock {
    /// Makes a block. `agents`: at least one, all of one kind.
    pub fn new(domain: Arc<dyn Domain>, config: &Config, agents: &[AgentId], threads: Threads) -> Self {
        let mut policies = initial_policies(&*domain, config, agents);
        policies.use_threads(threads);
        let learner = KindLearner {
            spec: domain.kinds().of(agents[0]).spec.clone(),
            adam: Adam::new(policies.parameters()),
            streams: agents.iter().map(|&agent| AgentStream::begin(config, &policies, agent)).collect(),
            policies,
            steps: 0,
        };
        AgentBlock {
            learner,
            predictor: initial_aips(&*domain, config, agents),
            agents: agents.to_vec(),
            config: config.clone(),
            domain,
        }
    }

    /// Returns the state of the agents.
    pub fn state(&self) -> AgentsState {
        let KindLearner { policies, adam, steps, streams, .. } = &self.learner;
        let Moments { first, second, steps: optimiser_steps } = adam.moments().clone();
        AgentsState {
            steps: *steps,
            policies: policies.parameters().values().clone().into(),
            moments: JointMoments { first: first.into(), second: second.into(), steps: optimiser_steps },
            aips: self.aips(),
            streams: streams.clone(),
        }
    }

    /// Continues from a state of the same agents.
    pub fn restore(&mut self, state: AgentsState) {
        let JointMoments { first, second, steps } = state.moments;
        self.learner.steps = state.steps;
        self.learner.streams = state.streams;
        self.learner.policies.load(&state.policies.into_rows());
        self.learner.adam.restore(Moments { first: first.into_rows(), second: second.into_rows(), steps });
        self.predictor.load(&state.aips.into_rows());
    }

    /// Trains the influence predictors; `datasets`: one per agent. `work`: progress is the share that is done.
    pub fn train_aips(&mut self, datasets: &[Dataset], period: &Period, work: Work<'_, f64>) -> Vec<AipLoss> {
        let seed = Seed::new(self.config.seed).fork(RandomPurpose::AipMinibatches).for_steps(period.start);
        train(&mut *self.predictor, &self.agents, datasets, &self.config.aip, seed, work)
    }

    /// Makes the policies imitate `demonstrations`, one per agent. `work`: progress is the share that is done.
    pub fn imitate(&mut self, demonstrations: &[Demonstrations], work: Work<'_, f64>) -> Vec<ImitationLoss> {
        let seed = Seed::new(self.config.seed).fork(RandomPurpose::ImitationMinibatches);
        imitate(&mut self.learner.policies, &self.agents, demonstrations, &self.config.imitation, seed, work)
    }

    /// Returns the policies, one row per agent.
    pub fn policies(&self) -> JointPolicy {
        self.learner.policies.parameters().values().clone().into()
    }

    /// Measures the loss of the influence predictors; `datasets`: one per agent.
    pub fn measure_aips(&self, datasets: &[Dataset], watch: &mut Stopwatch) -> Vec<FreshLoss> {
        measure(&*self.predictor, datasets, watch)
    }

    /// Returns what the influence predictors have learnt, one row per agent.
    pub fn aips(&self) -> Ragged<f32> {
        self.predictor.values().into()
    }

    /// Trains the policies on local simulators until the end of the period (Algorithm 1, lines 7 to 12). `work`: progress
    /// is the number of timesteps so far.
    pub fn train_policies(&mut self, period: &Period, work: Work<'_, u64>) -> Result<PolicyTraining> {
        let AgentBlock { domain, config, agents, learner, predictor } = self;
        let make = || domain.local_simulator(agents, config.copies(), training_episodes(config));
        let simulators = work.watch.time(Phase::Loading, make)?;
        let stagger = config.local_simulators.stagger;
        let alive = &mut || (work.progress)(learner.steps);
        let resume = || Ials::resume(simulators, &mut **predictor, &learner.streams, stagger, alive);
        let mut ials = work.watch.time(Phase::Retracing, resume)?;
        let mut training = learn(&mut [learner], &mut ials, config, period, work)?.remove(0);
        training.counters = ials.counters().into_iter().map(|(name, count)| (name.to_owned(), count)).collect();
        Ok(training)
    }
}

/// Trains the policies on the GS, on which all kinds act at once. `blocks`: one per kind, with all its agents.
pub fn train_policies_on_the_gs(
    domain: &dyn Domain,
    config: &Config,
    blocks: &mut [AgentBlock],
    period: &Period,
    work: Work<'_, u64>,
) -> Result<Vec<PolicyTraining>> {
    let simulator = work.watch.time(Phase::Loading, || domain.global_simulator())?;
    let mut learners: Vec<&mut KindLearner> = blocks.iter_mut().map(|block| &mut block.learner).collect();
    let streams: Vec<&[AgentStream]> = learners.iter().map(|learner| &learner.streams[..]).collect();
    let alive = &mut || (work.progress)(learners[0].steps);
    let resume = || GlobalEnvironment::resume(simulator, training_episodes(config), &streams, alive);
    let mut gs = work.watch.time(Phase::Retracing, resume)?;
    learn(&mut learners, &mut gs, config, period, work)
}

/// Returns the stream of the episodes that policies are trained in.
pub fn training_episodes(config: &Config) -> Seed {
    Seed::new(config.seed).fork(RandomPurpose::TrainingEpisodes)
}

/// Returns the number of steps of an episode that policies are trained on.
pub(super) fn episode_steps(spec: &RegionSpec, config: &Config) -> usize {
    if config.simulator == Simulator::Global { spec.horizon } else { spec.local_horizon }
}

/// A learner's working memory for a period.
struct Desk {
    memory: Memory,
    actor: Actor,
    minibatches: Vec<Dice>,
    /// Means over the updates, one per agent.
    losses: Vec<Losses>,
}

impl Desk {
    fn of(learner: &KindLearner, config: &Config) -> Desk {
        let KindLearner { spec, policies, streams, .. } = learner;
        let (agents, state_width) = (policies.agents(), policies.state_width());
        Desk {
            memory: Memory::new(agents, config.ppo.memory, config.sequence_length(), spec, state_width),
            actor: Actor::resume(policies, streams, episode_steps(spec, config)),
            minibatches: streams.iter().map(|stream| stream.minibatches.clone()).collect(),
            losses: vec![Losses::default(); agents],
        }
    }
}

/// Returns what learns in an update after this number of timesteps per agent.
fn learns_at(config: &Config, steps: u64) -> Learns {
    if steps < config.critic_steps() { Learns::Critic } else { Learns::Everything }
}

/// Alternates rollouts and updates until the first multiple of the memory at or after the end of the period.
/// `learners`: one per kind of the environment, all after the same number of steps.
fn learn(
    learners: &mut [&mut KindLearner],
    environment: &mut dyn Environment,
    config: &Config,
    period: &Period,
    work: Work<'_, u64>,
) -> Result<Vec<PolicyTraining>> {
    let Work { watch, progress } = work;
    let ppo = &config.ppo;
    let copies = environment.percepts()[0].obs.len() / learners[0].policies.agents();
    let mut desks: Vec<Desk> = learners.iter().map(|learner| Desk::of(learner, config)).collect();
    let mut steps = learners[0].steps;
    let updates = period.end.saturating_sub(steps).div_ceil(ppo.memory as u64);
    let shared = config.shares_policies();
    let decayed_at = |steps: u64| {
        let decayed = Decayed::at(ppo, steps as f64 / config.total_steps as f64);
        match learns_at(config, steps) {
            Learns::Everything => decayed,
            // Alone, a critic that begins at random learns as fast as the policy has imitated.
            Learns::Critic => Decayed { learning_rate: config.imitation.learning_rate, ..decayed },
        }
    };
    let mut decayed = decayed_at(steps);
    for _ in 0..updates {
        let player = |(learner, desk)| -> KindAtPlay<'_> {
            let (KindLearner { policies, .. }, Desk { actor, memory, .. }): (&&mut KindLearner, &mut Desk) =
                (learner, desk);
            KindAtPlay { policies, actor, memory, shared_bootstrap: shared }
        };
        let mut players: Vec<KindAtPlay> = learners.iter().zip(&mut desks).map(player).collect();
        for slot in (0..ppo.memory).step_by(ppo.rollout_steps * copies) {
            roll_out(environment, &mut players, slot, ppo, watch)?;
        }
        decayed = decayed_at(steps);
        let settings = Settings { ppo, decayed, learns: learns_at(config, steps), shared };
        let before = steps.checked_sub(ppo.memory as u64).map(|before| learns_at(config, before));
        for (learner, desk) in learners.iter_mut().zip(&mut desks) {
            let KindLearner { policies, adam, .. } = &mut **learner;
            if before.is_some_and(|before| before != settings.learns) {
                // The actor's first steps would be far too long with the step count of the critic.
                adam.begin_again();
            }
            let of_update = ppo::update(policies, adam, &desk.memory, &mut desk.minibatches, settings, watch);
            let weight = 1.0 / updates as f64;
            desk.losses.iter_mut().zip(&of_update).for_each(|(mean, of_update)| mean.add(of_update, weight));
        }
        steps += ppo.memory as u64;
        progress(steps);
    }
    environment.leave(&mut learners.iter_mut().map(|learner| &mut learner.streams[..]).collect::<Vec<_>>());
    let done = learners.iter_mut().zip(desks).map(|(learner, desk)| {
        learner.steps = steps;
        desk.actor.leave(&mut learner.streams);
        let streams = learner.streams.iter_mut().zip(desk.minibatches);
        streams.for_each(|(stream, dice)| stream.minibatches = dice);
        let agents = desk.actor.returns.means().into_iter().zip(desk.losses);
        let agents = agents.map(|((mean_return, episodes), losses)| AgentTraining { mean_return, episodes, losses });
        PolicyTraining { agents: agents.collect(), counters: Vec::new(), decayed }
    });
    Ok(done.collect())
}
