//! A block: agents of one kind that are trained together, on one stack of networks and one forest of local simulators.
//!
//! A worker trains its blocks one after the other, each for the whole period, which changes no number. The networks and
//! cars of a few agents stay in the cache. On copies of the GS all blocks act at once, one block per kind.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::algorithms::imitation::{ImitationLoss, imitate};
use crate::algorithms::{self, Brought, Learner, Metrics};
use crate::config::{Config, Period, Simulator};
use crate::environments::copies::GlobalCopies;
use crate::environments::global::{Begin, GlobalEnvironment};
use crate::environments::ials::Ials;
use crate::environments::{Environment, Experience};
use crate::policy::{Demonstrations, JointPolicy, PolicyStack};
use crate::predictors::{AipLoss, Dataset, FreshLoss, TrainablePredictor, measure, train};
use crate::state::AgentsState;
use crate::state::stream::{AgentStream, rows_of, rows_of_mut};
use crate::steps::train_policies::{AgentTraining, PolicyTraining};
use dials_core::base::{AgentId, Phase, Ragged, RandomPurpose, Seed, Stopwatch, Work};
use dials_core::domain::{Action, Domain, Kinds, RegionSpec, Result};
use stacknets::Threads;

/// Number of local simulators per block. The cars of a larger forest leave the cache between two steps. Measured on
/// traffic, SUMO costs the same per intersection with 8 and 16, 10 % more with 32, 15 % more with 64 and 60 % more with
/// 128.
const ROWS_PER_BLOCK: usize = 16;

/// All that belongs to some agents of one kind during the whole run.
pub(crate) struct AgentBlock {
    domain: Arc<dyn Domain>,
    config: Config,
    agents: Vec<AgentId>,
    learner: KindLearner,
    predictor: Box<dyn TrainablePredictor>,
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
    let policies = PolicyStack::new(agents, &kind.spec, &config.policy, &domain.initial_action_bias(kind), seed);
    policies.read_as(algorithms::of(config).reading())
}

/// Makes the first influence predictors of `agents`, which are of one kind.
pub fn initial_aips(domain: &dyn Domain, config: &Config, agents: &[AgentId]) -> Box<dyn TrainablePredictor> {
    let seed = Seed::new(config.seed).fork(RandomPurpose::Aip);
    let spec = &domain.kinds().of(agents[0]).spec;
    config.predictor().kind().make(agents, spec, &config.aip, seed)
}

/// Returns the number of agents per block. On the GS all agents act at once, so there is one block per kind.
pub(crate) fn agents_per_block(config: &Config) -> usize {
    if config.simulator == Simulator::Global { usize::MAX } else { (ROWS_PER_BLOCK / config.copies()).max(1) }
}

impl AgentBlock {
    /// Makes a block. `agents`: at least one, all of one kind.
    pub(crate) fn new(domain: Arc<dyn Domain>, config: &Config, agents: &[AgentId], threads: Threads) -> Self {
        let mut policies = initial_policies(&*domain, config, agents);
        policies.net.use_threads(threads);
        let spec = domain.kinds().of(agents[0]).spec.clone();
        let learner = KindLearner {
            learner: algorithms::of(config).learner(config, &spec, agents, policies),
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
        train(&mut *self.predictor, &self.agents, datasets, &self.config.aip, seed, work)
    }

    /// Makes the policies imitate `demonstrations`, one per agent. `work`: progress is the share that is done.
    pub(crate) fn imitate(&mut self, demonstrations: &[Demonstrations], work: Work<'_, f64>) -> Vec<ImitationLoss> {
        let seed = Seed::new(self.config.seed).fork(RandomPurpose::ImitationMinibatches);
        imitate(self.learner.learner.policies_mut(), &self.agents, demonstrations, &self.config.imitation, seed, work)
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

    /// Trains the policies on local simulators until the end of the period (Algorithm 1, lines 7 to 12). `work`:
    /// progress is the number of timesteps so far.
    pub(crate) fn train_policies(&mut self, period: &Period, work: Work<'_, u64>) -> Result<PolicyTraining> {
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

/// Trains the policies on copies of the GS, on which all kinds act at once. `blocks`: one per kind, with all its agents.
pub(crate) fn train_policies_on_the_gs(
    simulators: Box<dyn GlobalCopies>,
    kinds: &Kinds,
    config: &Config,
    blocks: &mut [AgentBlock],
    period: &Period,
    work: Work<'_, u64>,
) -> Result<Vec<PolicyTraining>> {
    let mut learners: Vec<&mut KindLearner> = blocks.iter_mut().map(|block| &mut block.learner).collect();
    let streams: Vec<&[AgentStream]> = learners.iter().map(|learner| &learner.streams[..]).collect();
    let alive = &mut || (work.progress)(learners[0].steps);
    let stagger = config.local_simulators.stagger;
    let begin = Begin { kinds, episodes: training_episodes(config), stagger, turns: config.turns() };
    let resume = || GlobalEnvironment::resume(simulators, begin, &streams, alive);
    let mut gs = work.watch.time(Phase::Retracing, resume)?;
    learn(&mut learners, &mut gs, config, period, work)
}

pub fn training_episodes(config: &Config) -> Seed {
    Seed::new(config.seed).fork(RandomPurpose::TrainingEpisodes)
}

/// Returns the number of steps of an episode that policies are trained on.
pub(crate) fn episode_steps(spec: &RegionSpec, config: &Config) -> usize {
    if config.simulator == Simulator::Global { spec.horizon } else { spec.local_horizon }
}

/// Lets the learners act and learn until the first update at or after the end of the period. `learners`: one per kind
/// of the environment, all after the same number of steps.
///
/// In a round every turn makes its decisions one after the other. Turns do not wait for each other, and what they do depends on
/// nothing that another one does.
fn learn(
    learners: &mut [&mut KindLearner],
    environment: &mut dyn Environment,
    config: &Config,
    period: &Period,
    work: Work<'_, u64>,
) -> Result<Vec<PolicyTraining>> {
    let Work { watch, progress } = work;
    let turns = environment.turns();
    let copies = config.copies() / turns;
    let in_turn = if turns == 1 { 1 } else { algorithms::of(config).decisions_in_turn() };
    let per_update = algorithms::of(config).steps_per_update() as u64;
    let mut steps = learners[0].steps;
    let end = config.update_at_or_after(period.end);
    let returns = |kind: &&mut KindLearner| EpisodeReturns::resume(&kind.streams, episode_steps(&kind.spec, config));
    let mut returns: Vec<EpisodeReturns> = learners.iter().map(returns).collect();
    let mut updates: Vec<Vec<Metrics>> = vec![Vec::new(); learners.len()];
    while steps < end {
        let mut left = vec![in_turn; turns];
        let mut waiting: VecDeque<usize> = (0..turns).collect();
        let mut open = 0;
        loop {
            while open < environment.at_once()
                && let Some(turn) = waiting.pop_front()
            {
                let percepts = environment.percepts(turn);
                let actions: Vec<Vec<Action>> = watch.time(Phase::Acting, || {
                    learners.iter_mut().zip(percepts).map(|(kind, percept)| kind.learner.act(turn, percept)).collect()
                });
                environment.begin(turn, &actions, watch)?;
                open += 1;
            }
            if open == 0 {
                break;
            }
            let turn = environment.finish(watch)?;
            (open, steps) = (open - 1, steps + copies as u64);
            let brought = environment.experiences(turn).iter().zip(environment.percepts(turn));
            for (index, (kind, (experience, next))) in learners.iter_mut().zip(brought).enumerate() {
                returns[index].add(turn * copies, experience);
                updates[index].extend(kind.learner.learn(turn, Brought { experience, next, steps }, watch));
            }
            left[turn] -= 1;
            if left[turn] > 0 {
                // Its cars are still in the cache.
                waiting.push_front(turn);
            }
        }
        if steps.is_multiple_of(per_update) {
            progress(steps);
        }
    }
    environment.leave(&mut learners.iter_mut().map(|kind| &mut kind.streams[..]).collect::<Vec<_>>());
    let done = learners.iter_mut().zip(returns).zip(updates).map(|((kind, returns), updates)| {
        kind.steps = steps;
        returns.leave(&mut kind.streams);
        let agents = returns.means().into_iter();
        PolicyTraining {
            agents: agents.map(|(mean_return, episodes)| AgentTraining { mean_return, episodes }).collect(),
            metrics: Metrics::mean(&updates, kind.learner.no_metrics()),
            updates: updates.len(),
            counters: Vec::new(),
        }
    });
    Ok(done.collect())
}

/// Returns of the episodes that ended in this period, per agent.
///
/// First episodes that were cut short by staggering do not count.
#[derive(Clone, Debug)]
struct EpisodeReturns {
    horizon: usize,
    copies: usize,
    /// Sum of rewards and number of steps since the episode began, and number of steps in this period, per row.
    running: Vec<(f64, usize, usize)>,
    /// The episodes that ended: step of this period, row and return.
    finished: Vec<(usize, usize, f64)>,
}

impl EpisodeReturns {
    /// Continues the current episodes. `horizon`: number of steps of a whole episode.
    fn resume(streams: &[AgentStream], horizon: usize) -> Self {
        let running = rows_of(streams).map(|row| (row.rewards, row.trail.steps(), 0));
        EpisodeReturns { horizon, copies: streams[0].rows.len(), running: running.collect(), finished: Vec::new() }
    }

    /// Adds what a decision of consecutive copies of all agents brought, from copy `first` on.
    fn add(&mut self, first: usize, experience: &Experience) {
        let of_turn = experience.rewards.len() * self.copies / self.running.len();
        for (row, (&reward, &ends)) in experience.rewards.iter().zip(&experience.ends).enumerate() {
            let row = row / of_turn * self.copies + first + row % of_turn;
            let (sum, steps, step) = &mut self.running[row];
            *sum += f64::from(reward);
            (*steps, *step) = (*steps + 1, *step + 1);
            if ends {
                if *steps == self.horizon {
                    self.finished.push((*step, row, *sum));
                }
                (*sum, *steps) = (0.0, 0);
            }
        }
    }

    /// Returns the mean return and the number of episodes, per agent. If no episode ended: `None` and 0.
    ///
    /// They are added up in the order of their steps, whichever turn came first.
    fn means(&self) -> Vec<(Option<f64>, u64)> {
        let mut in_order = self.finished.clone();
        in_order.sort_by_key(|&(step, row, _)| (step, row));
        let mut sums = vec![(0.0, 0); self.running.len() / self.copies];
        for (_, row, episode_return) in in_order {
            let (sum, episodes) = &mut sums[row / self.copies];
            *sum += episode_return;
            *episodes += 1;
        }
        let mean = |&(sum, episodes): &(f64, u64)| ((episodes > 0).then(|| sum / episodes as f64), episodes);
        sums.iter().map(mean).collect()
    }

    /// Writes the sums of the unfinished episodes to the streams.
    fn leave(&self, streams: &mut [AgentStream]) {
        self.running.iter().zip(rows_of_mut(streams)).for_each(|((rewards, ..), stream)| stream.rewards = *rewards);
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
        let mut returns = EpisodeReturns::resume(&streams, 3);
        let experience = |ends: [bool; 2]| Experience {
            rewards: vec![1.5, 0.25],
            ends: ends.to_vec(),
            last_obs: Rows::new(2, 1),
            last_masks: None,
        };
        // The first agent ends after two steps and then after three, the second one never.
        for ends in [false, true, false, false, true, false] {
            returns.add(0, &experience([ends, false]));
        }
        assert_eq!(returns.means(), [(Some(4.5), 1), (None, 0)]);
        returns.leave(&mut streams);
        assert_eq!([streams[0].rows[0].rewards, streams[1].rows[0].rewards], [1.5, 1.5]);
    }
}
