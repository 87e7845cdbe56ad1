//! A block: agents of one kind that are trained together, on one stack of networks and one forest of local simulators.
//!
//! A worker trains its blocks one after the other, each for the whole period, which changes no number. The networks and
//! cars of a few agents stay in the cache. On copies of the GS all blocks act at once, one block per kind.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;

use crate::algorithms::imitation::{ImitationLoss, imitate};
use crate::algorithms::{self, Actor, Learner};
use crate::config::{Config, Period, ROWS_PER_BLOCK, Simulator, most_lanes};
use crate::environments::global::{self, Begin};
use crate::environments::ials::Ials;
use crate::environments::lanes::{Lane, Lanes};
use crate::environments::makers::{GlobalCopies, MakeSimulators};
use crate::environments::{Environment, Experience};
use crate::policy::{Demonstrations, JointPolicy, PolicyStack};
use crate::predictors::{AipLoss, Dataset, FreshLoss, TrainablePredictor, measure, train};
use crate::side_by_side::in_threads;
use crate::state::AgentsState;
use crate::state::stream::{AgentStream, Part};
use crate::steps::train_policies::{AgentTraining, PolicyTraining};
use dials_core::base::{AgentId, Phase, Ragged, RandomPurpose, Rows, Seed, Stopwatch, Work};
use dials_core::domain::{Action, Domain, Kinds, Percept, RegionSpec, Result};
use stacknets::Threads;

/// All that belongs to some agents of one kind during the whole run.
pub(crate) struct AgentBlock {
    domain: Arc<dyn Domain>,
    config: Config,
    agents: Vec<AgentId>,
    learner: KindLearner,
    predictor: Box<dyn TrainablePredictor>,
    /// The rows of each lane.
    parts: Vec<Part>,
}

/// The learner of some agents of one kind, and how far it has come.
struct KindLearner {
    spec: RegionSpec,
    learner: Box<dyn Learner>,
    steps: u64,
    streams: Vec<AgentStream>,
}

/// Makes the first policies of `agents`, which are of one kind.
///
/// DEVIATION 21: every agent has weights of its own. In the authors' code all agents begin with the same.
pub fn initial_policies(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> PolicyStack {
    let seed = Seed::new(config.seed).fork(RandomPurpose::Policy);
    let kind = domain.kinds().of(agents[0]);
    // The mean of random policies that differ would be worse than each.
    let begins_as_one = config.shares_policies() || config.policy.average_every_steps.is_some();
    let alike = begins_as_one.then(|| vec![kind.agents[0]; agents.len()]);
    let agents = alike.as_deref().unwrap_or(agents);
    let mut policies = PolicyStack::new(agents, &kind.spec, &config.policy, &domain.initial_action_bias(kind), seed);
    if let Some(name) = &config.policy.start {
        let start = domain.starting_policy(name).expect("the config was checked for it");
        let mut all = Rows::new(agents.len(), start.parameters.width());
        (0..agents.len()).for_each(|agent| all.row_mut(agent).copy_from_slice(start.parameters.row(0)));
        policies.load(&all);
    }
    policies.read_as(algorithms::of(config).reading())
}

/// Makes the first influence predictors of `agents`, which are of one kind.
pub fn initial_aips(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> Box<dyn TrainablePredictor> {
    let seed = Seed::new(config.seed).fork(RandomPurpose::Aip);
    let spec = &domain.kinds().of(agents[0]).spec;
    config.predictor().kind().make(agents, spec, &config.aip, seed)
}

/// Returns the number of agents per block. Agents of a kind that act at once or have one policy are one block.
pub(crate) fn agents_per_block(config: &Config) -> usize {
    if config.learns_at_one_place() { usize::MAX } else { (ROWS_PER_BLOCK / config.copies()).max(1) }
}

impl AgentBlock {
    /// Makes a block. `agents`: at least one, all of one kind.
    pub(crate) fn new(domain: Arc<dyn Domain>, config: &Config, agents: &[AgentId], threads: Threads) -> Self {
        // A process holds one simulation of a foreign simulator. A native one takes little time beside learning. So do a few
        // rows beside the messages to another process.
        let is_shared_out = config.shares_policies() && domain.foreign_simulator().is_some();
        let most = most_lanes(agents.len() * config.copies());
        let lanes = if is_shared_out { threads.count().min(most) } else { 1 };
        let parts = config.parts(agents.len(), lanes);
        let mut policies = initial_policies(&*domain, config, agents);
        policies.net.use_threads(threads);
        if config.shares_policies() {
            policies.net.keep_alike();
        }
        let spec = domain.kinds().of(agents[0]).spec.clone();
        let learner = KindLearner {
            learner: algorithms::of(config).learner(config, &spec, agents, policies, &parts),
            spec,
            steps: 0,
            streams: agents.iter().map(|&agent| AgentStream::begin(config, agent)).collect(),
        };
        AgentBlock {
            learner,
            predictor: initial_aips(&*domain, config, agents),
            agents: agents.to_vec(),
            config: config.clone(),
            domain,
            parts,
        }
    }

    pub(crate) fn state(&self) -> AgentsState {
        let KindLearner { learner, steps, streams, .. } = &self.learner;
        AgentsState {
            steps: *steps,
            policies: self.policies(),
            learners: learner.tables(),
            aips: self.aips(),
            streams: streams.clone(),
            outside_aips: Vec::new(),
        }
    }

    pub(crate) fn restore(&mut self, state: AgentsState) {
        self.learner.steps = state.steps;
        self.learner.streams = state.streams;
        self.learner.learner.policies_mut().load(&state.policies.into_rows());
        self.learner.learner.load(state.learners);
        self.predictor.load(&state.aips.into_rows());
    }

    /// Trains the influence predictors; `datasets`: one per agent. `work`: progress is the share that is done.
    pub(crate) fn train_aips(&mut self, datasets: &[Dataset], period: &Period, work: Work<'_, f64>) -> Vec<AipLoss> {
        let seed = Seed::new(self.config.seed).fork(RandomPurpose::AipMinibatches).for_steps(period.start);
        let threads = self.learner.learner.policies().net.threads();
        train(&mut *self.predictor, &self.agents, datasets, (&self.config.aip, threads), seed, work)
    }

    /// Makes the policies imitate `demonstrations`, one per agent. `work`: progress is the share that is done.
    pub(crate) fn imitate(&mut self, demonstrations: &[Demonstrations], work: Work<'_, f64>) -> Vec<ImitationLoss> {
        imitate(self.learner.learner.policies_mut(), &self.agents, demonstrations, &self.config, work)
    }

    pub(crate) fn policies(&self) -> JointPolicy {
        self.learner.learner.policies().parameters().values().clone().into()
    }

    /// Measures the loss of the influence predictors; `datasets`: one per agent.
    pub(crate) fn measure_aips(&self, datasets: &[Dataset], watch: &mut Stopwatch) -> Vec<FreshLoss> {
        measure(&*self.predictor, datasets, watch)
    }

    pub(crate) fn aips(&self) -> Ragged<f32> {
        self.predictor.values().into()
    }

    /// Trains the policies on local simulators until the end of the period (Algorithm 1, lines 7 to 12). `so_far`: what the
    /// period has brought before. `makers`: who makes those of several lanes; `work`: progress is the number of timesteps so
    /// far.
    pub(crate) fn train_policies(
        &mut self,
        (period, so_far): (&Period, Option<PolicyTraining>),
        makers: &dyn MakeSimulators,
        work: Work<'_, u64>,
    ) -> Result<PolicyTraining> {
        let AgentBlock { domain, config, agents, learner, predictor, parts } = self;
        let (copies, episodes) = (config.copies(), training_episodes(config));
        let stagger = config.local_simulators.stagger;
        let alive = &mut || (work.progress)(learner.steps);
        let mut of_lanes: Vec<Box<dyn TrainablePredictor>> = Vec::new();
        let mut lanes = if let [whole] = &parts[..] {
            let make = || domain.local_simulator(agents, copies, episodes);
            let simulators = work.watch.time(Phase::Loading, make)?;
            let resume = || Ials::resume(simulators, &mut **predictor, whole.clone(), &learner.streams, stagger, alive);
            let ials = Box::new(work.watch.time(Phase::Retracing, resume)?);
            Lanes::Here(vec![Lane { parts: parts.clone(), environment: ials as Box<dyn Environment + '_> }])
        } else {
            let mut simulators = Vec::new();
            for part in &*parts {
                let (range, agents) = (part.agents.clone(), &agents[part.agents.clone()]);
                let make = || makers.apart(&**domain, agents, copies, episodes);
                let made = work.watch.time(Phase::Loading, make);
                simulators.push(made.context("nobody makes the simulators of a second lane")??);
                let mut own = initial_aips(&**domain, config, agents);
                own.load(&Ragged::from(predictor.values()).pick(range).into_rows());
                of_lanes.push(own);
            }
            let threads = learner.learner.policies().net.threads().clone();
            let items: Vec<_> = simulators.into_iter().zip(&mut of_lanes).zip(&*parts).collect();
            let streams = &learner.streams;
            let resume = || {
                let lanes = in_threads(&threads, items, alive, |_: &mut (), ((simulators, predictor), part), alive| {
                    let ials = Ials::resume(simulators, &mut **predictor, part.clone(), streams, stagger, alive)?;
                    let environment = Box::new(ials) as Box<dyn Environment + Send + '_>;
                    Ok(Lane { parts: vec![part.clone()], environment })
                });
                lanes.into_iter().collect::<Result<_>>()
            };
            Lanes::Apart(work.watch.time(Phase::Retracing, resume)?, threads.clone())
        };
        Ok(learn(&mut [learner], &mut lanes, config, (period, vec![so_far]), work)?.remove(0))
    }
}

/// Trains the policies on copies of the GS, on which all kinds act at once. `blocks`: one per kind, with all its agents;
/// `so_far`: what the period has brought each.
pub(crate) fn train_policies_on_the_gs(
    simulators: GlobalCopies,
    kinds: &Kinds,
    config: &Config,
    blocks: &mut [AgentBlock],
    (period, so_far): (&Period, Vec<Option<PolicyTraining>>),
    work: Work<'_, u64>,
) -> Result<Vec<PolicyTraining>> {
    let mut learners: Vec<&mut KindLearner> = blocks.iter_mut().map(|block| &mut block.learner).collect();
    let streams: Vec<&[AgentStream]> = learners.iter().map(|learner| &learner.streams[..]).collect();
    let alive = &mut || (work.progress)(learners[0].steps);
    let stagger = config.local_simulators.stagger;
    let threads = &learners[0].learner.policies().net.threads().clone();
    let begin = Begin { kinds, episodes: training_episodes(config), stagger, threads };
    let mut copies = work.watch.time(Phase::Retracing, || global::resume(simulators, &begin, &streams, alive))?;
    learn(&mut learners, &mut copies, config, (period, so_far), work)
}

pub fn training_episodes(config: &Config) -> Seed {
    Seed::new(config.seed).fork(RandomPurpose::TrainingEpisodes)
}

/// Returns the number of steps of an episode that policies are trained on.
pub(crate) fn episode_steps(spec: &RegionSpec, config: &Config) -> usize {
    if config.simulator == Simulator::Global { spec.horizon } else { spec.local_horizon }
}

/// Lets the learners act and learn until the first update at or after the end of the period. `learners`: one per kind
/// of the environments, all after the same number of steps; `so_far`: what the period has brought each.
fn learn(
    learners: &mut [&mut KindLearner],
    lanes: &mut Lanes<'_>,
    config: &Config,
    (period, so_far): (&Period, Vec<Option<PolicyTraining>>),
    work: Work<'_, u64>,
) -> Result<Vec<PolicyTraining>> {
    let Work { watch, progress } = work;
    let decisions = algorithms::of(config).decisions_in_a_round();
    let per_update = algorithms::of(config).steps_per_update() as u64;
    // Beside other lanes, a lane has one thread.
    let threads = if lanes.are_apart() { Threads::one() } else { learners[0].learner.policies().net.threads().clone() };
    let mut steps = learners[0].steps;
    let end = config.update_at_or_after(period.end);
    let returns_of = |(kind, part): (&&mut KindLearner, &Part)| {
        EpisodeReturns::resume(&kind.streams, part, episode_steps(&kind.spec, config))
    };
    let mut returns: Vec<Vec<EpisodeReturns>> =
        lanes.parts().into_iter().map(|parts| learners.iter().zip(parts).map(returns_of).collect()).collect();
    let nothing = |kind: &KindLearner| PolicyTraining {
        agents: vec![AgentTraining::default(); kind.streams.len()],
        metrics: kind.learner.no_metrics(),
        updates: 0,
        counters: Vec::new(),
    };
    let begin = learners.iter().zip(so_far);
    let mut done: Vec<PolicyTraining> = begin.map(|(kind, so_far)| so_far.unwrap_or_else(|| nothing(kind))).collect();
    while steps < end {
        for (number, kind) in learners.iter_mut().enumerate() {
            let shown: Vec<&Percept> = lanes.percepts().into_iter().map(|of_lane| &of_lane[number]).collect();
            kind.learner.look(&shown, steps, watch)?;
        }
        let mut players: Vec<Player<'_>> =
            returns.iter_mut().map(|returns| Player { actors: Vec::new(), returns }).collect();
        for kind in &mut *learners {
            let actors = kind.learner.actors(&threads);
            players.iter_mut().zip(actors).for_each(|(player, actor)| player.actors.push(actor));
        }
        let begun = Instant::now();
        let played = lanes.each(players, |environment, player| player.play(environment, decisions));
        let mut phases = Stopwatch::default();
        played.into_iter().try_for_each(|of_lane| of_lane.map(|of_lane| phases.add(&of_lane)))?;
        watch.add(&if lanes.are_apart() { phases.scaled_to(begun.elapsed()) } else { phases });
        steps += (decisions * config.copies()) as u64;
        for (kind, done) in learners.iter_mut().zip(&mut done) {
            if let Some(update) = kind.learner.learn(steps, watch)? {
                done.metrics.add(update);
                done.updates += 1;
            }
        }
        if steps.is_multiple_of(per_update) {
            progress(steps);
        }
    }
    done[0].counters = lanes.leave(&mut learners.iter_mut().map(|kind| &mut kind.streams[..]).collect::<Vec<_>>());
    for (number, (kind, done)) in learners.iter_mut().zip(&mut done).enumerate() {
        kind.steps = steps;
        kind.learner.leave()?;
        let returns: Vec<&EpisodeReturns> = returns.iter().map(|of_lane| &of_lane[number]).collect();
        returns.iter().for_each(|returns| returns.leave(&mut kind.streams));
        EpisodeReturns::add_up(&returns, &mut done.agents);
    }
    Ok(done)
}

/// Who plays in a lane.
struct Player<'a> {
    /// One per kind; the same for the returns.
    actors: Vec<Box<dyn Actor + 'a>>,
    returns: &'a mut [EpisodeReturns],
}

impl Player<'_> {
    /// Makes some decisions in every row.
    fn play(mut self, environment: &mut dyn Environment, decisions: usize) -> Result<Stopwatch> {
        let mut watch = Stopwatch::default();
        for _ in 0..decisions {
            let shown = self.actors.iter_mut().zip(environment.percepts());
            let act = || shown.map(|(actor, percept)| actor.act(percept)).collect();
            let actions: Vec<Vec<Action>> = watch.time(Phase::Acting, act);
            environment.step(&actions, &mut watch)?;
            let brought = environment.experiences().iter().zip(environment.percepts());
            for ((actor, returns), (experience, next)) in self.actors.iter_mut().zip(&mut *self.returns).zip(brought) {
                returns.add(experience);
                actor.take_in(experience, next, &mut watch);
            }
        }
        Ok(watch)
    }
}

/// Returns of the episodes that ended in this period, in the rows of a lane.
///
/// First episodes that were cut short by staggering do not count.
#[derive(Clone, Debug)]
struct EpisodeReturns {
    part: Part,
    horizon: usize,
    /// Sum of rewards and number of steps since the episode began, and number of steps in this period, per row.
    running: Vec<(f64, usize, usize)>,
    /// The episodes that ended: step of this period, agent and copy, and return.
    finished: Vec<(usize, (usize, usize), f64)>,
}

impl EpisodeReturns {
    /// Continues the current episodes of a part. `horizon`: number of steps of a whole episode.
    fn resume(streams: &[AgentStream], part: &Part, horizon: usize) -> Self {
        let running = part.of(streams).map(|row| (row.rewards, row.trail.steps(), 0));
        EpisodeReturns { horizon, running: running.collect(), finished: Vec::new(), part: part.clone() }
    }

    /// Adds what a decision brought.
    fn add(&mut self, experience: &Experience) {
        for (row, (&reward, &ends)) in experience.rewards.iter().zip(&experience.ends).enumerate() {
            let (sum, steps, step) = &mut self.running[row];
            *sum += f64::from(reward);
            (*steps, *step) = (*steps + 1, *step + 1);
            if ends {
                if *steps == self.horizon {
                    self.finished.push((*step, self.part.place(row), *sum));
                }
                (*sum, *steps) = (0.0, 0);
            }
        }
    }

    /// Adds the episodes in all lanes to those of each agent, in the order of their steps, in whichever lane they were.
    fn add_up(lanes: &[&EpisodeReturns], agents: &mut [AgentTraining]) {
        let mut in_order: Vec<_> = lanes.iter().flat_map(|lane| lane.finished.iter().copied()).collect();
        in_order.sort_by_key(|&(step, place, _)| (step, place));
        for (_, (agent, _), episode_return) in in_order {
            agents[agent].returns += episode_return;
            agents[agent].episodes += 1;
        }
    }

    /// Writes the sums of the unfinished episodes to the streams.
    fn leave(&self, streams: &mut [AgentStream]) {
        self.running
            .iter()
            .zip(self.part.of_mut(streams))
            .for_each(|((rewards, ..), stream)| stream.rewards = *rewards);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::stream::RowStream;
    use dials_core::base::{Rows, Seed};

    #[test]
    fn only_whole_episodes_count_as_returns() {
        let row = || RowStream::begin(Seed::new(0).dice());
        let mut streams = [AgentStream { rows: vec![row()] }, AgentStream { rows: vec![row()] }];
        let mut returns = EpisodeReturns::resume(&streams, &Part { agents: 0..2, copies: 0..1 }, 3);
        let experience = |ends: [bool; 2]| Experience {
            rewards: vec![1.5, 0.25],
            ends: ends.to_vec(),
            last_obs: Rows::new(2, 1),
            last_masks: None,
        };
        // The first agent ends after two steps and then after three, the second one never.
        for ends in [false, true, false, false, true, false] {
            returns.add(&experience([ends, false]));
        }
        // An earlier episode, with a return of 2.
        let before = AgentTraining { returns: 2.0, episodes: 1 };
        let mut agents = [before, AgentTraining::default()];
        EpisodeReturns::add_up(&[&returns], &mut agents);
        assert_eq!(agents, [AgentTraining { returns: 6.5, episodes: 2 }, AgentTraining::default()]);
        assert_eq!(agents.map(|agent| agent.mean_return()), [Some(3.25), None]);
        returns.leave(&mut streams);
        assert_eq!([streams[0].rows[0].rewards, streams[1].rows[0].rewards], [1.5, 1.5]);
    }
}
