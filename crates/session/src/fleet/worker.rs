//! A worker: a share of the agents for the whole run, with all that belongs to them.
//!
//! Its [`AgentBlock`]s hold policies, AIPs (approximate influence predictors) and optimisers. Local simulators exist
//! only during a period, because libsumo holds one simulation per process, and between periods the worker runs the
//! global simulator (GS). A period begins where [`AgentsState`] left the one before it, down to the cars on the road.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use super::telling::Telling;
use dials_core::base::{Activity, AgentId, Phase, Ragged, RandomPurpose, Seed, Stopwatch, Timesheet, Work};
use dials_core::domain::{Baseline, Controller, Domain, GlobalSimulator, Result};
use dials_learn::config::{Config, Period, Simulator};
use dials_learn::evaluation::{EpisodeReport, episode_seed, play};
use dials_learn::influence::{AipLoss, Dataset, FreshLoss};
use dials_learn::policy::{Demonstrations, JointPolicy, JointPolicyController, Selection};
use dials_learn::training::answers::PolicyTraining;
use dials_learn::training::block::{AgentBlock, agents_per_block, train_policies_on_the_gs};
use dials_learn::training::collect::{Purpose, collect_episode};
use dials_learn::training::imitation::{ImitationLoss, demonstrate};
use dials_learn::training::observer::Observer;
use dials_learn::training::state::AgentsState;
use dials_learn::training::timed::{Timed, TimedController};
use stacknets::Threads;

pub struct Worker {
    domain: Arc<dyn Domain>,
    config: Config,
    blocks: Vec<AgentBlock>,
    /// Places of the agents of every block among those of the worker: a block has agents of one kind.
    places: Vec<Vec<usize>>,
    timesheet: Timesheet,
}

impl Worker {
    /// Makes a worker. `threads`: for training the policies.
    pub fn new(domain: Arc<dyn Domain>, config: &Config, agents: Vec<AgentId>, threads: &Threads) -> Self {
        let mut places = Vec::new();
        for kind in 0..domain.kinds().count() {
            let of_kind = |&place: &usize| domain.kinds().place(agents[place]).kind == kind;
            let of_kind: Vec<usize> = (0..agents.len()).filter(of_kind).collect();
            places.extend(of_kind.chunks(agents_per_block(config)).map(<[usize]>::to_vec));
        }
        let block = |places: &Vec<usize>| {
            let agents: Vec<AgentId> = places.iter().map(|&place| agents[place]).collect();
            AgentBlock::new(domain.clone(), config, &agents, threads.clone())
        };
        Worker {
            blocks: places.iter().map(block).collect(),
            places,
            config: config.clone(),
            domain,
            timesheet: Timesheet::default(),
        }
    }

    /// Returns the state of its agents.
    pub fn state(&self) -> AgentsState {
        let joined = AgentsState::joined(self.blocks.iter().map(AgentBlock::state).collect());
        match self.order() {
            Some(order) => joined.share(order),
            None => joined,
        }
    }

    /// Continues from a state of the same agents.
    pub fn restore(&mut self, state: &AgentsState) {
        for (block, places) in self.blocks.iter_mut().zip(&self.places) {
            block.restore(state.share(places.iter().copied()));
        }
    }

    /// Returns the place of each of its agents when the blocks are put one after another; `None` if that is its own
    /// order.
    fn order(&self) -> Option<Vec<usize>> {
        let places = self.places.concat();
        let mut order: Vec<usize> = (0..places.len()).collect();
        order.sort_by_key(|&index| places[index]);
        (!places.is_sorted()).then_some(order)
    }

    /// Puts the results of its agents, block after block, into their own order.
    fn in_order<T>(&self, by_block: Vec<T>) -> Vec<T> {
        let mut with_places: Vec<(usize, T)> = self.places.iter().flatten().copied().zip(by_block).collect();
        with_places.sort_by_key(|&(place, _)| place);
        with_places.into_iter().map(|(_, of_agent)| of_agent).collect()
    }

    /// Splits one value per agent into the values of each block.
    fn by_block<T>(&self, of_agents: Vec<T>) -> Vec<Vec<T>> {
        let mut of_agents: Vec<Option<T>> = of_agents.into_iter().map(Some).collect();
        let mut take = |&place: &usize| of_agents[place].take().expect("an agent is in one block");
        self.places.iter().map(|places| places.iter().map(&mut take).collect()).collect()
    }

    /// Returns the time spent since the last call.
    pub fn take_timesheet(&mut self) -> Timesheet {
        self.timesheet.take()
    }

    /// Runs Algorithm 2 for some of the episodes. Returns the datasets of *all* agents, in the order of the episodes.
    pub fn collect(
        &mut self,
        policies: &JointPolicy,
        purpose: Purpose,
        episodes: Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<Dataset>> {
        let seed = purpose.stream(&self.config);
        let mut datasets = Dataset::of_all(self.domain.kinds());
        let activity = purpose.activity(&self.config);
        self.on_the_gs(activity, policies, episodes, observer, |simulator, controller, episode| {
            collect_episode(simulator, controller, seed.for_episode(episode), &mut datasets)
        })?;
        Ok(datasets)
    }

    /// Lets a hand-coded controller play some of the episodes in which it is imitated. Returns the demonstrations of
    /// *all* agents, in the order of the episodes.
    pub fn demonstrate(
        &mut self,
        controller: &str,
        episodes: Range<usize>,
        observer: &dyn Observer,
    ) -> Result<Vec<Demonstrations>> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let seed = Seed::new(self.config.seed).fork(RandomPurpose::Demonstrations);
        let mut demonstrations = Demonstrations::of_all(self.domain.kinds());
        let Baseline { simulator, mut controller } = watch.time(Phase::Loading, || self.domain.baseline(controller))?;
        let mut simulator = Timed::new(simulator);
        let decisions = episodes.len() * self.domain.kinds().horizon();
        let mut controller = Telling::new(&mut *controller, observer, Activity::Collection, decisions);
        for episode in episodes {
            let seed = seed.for_episode(episode);
            demonstrate(&mut simulator, &mut controller, seed, self.config.imitation.slips, &mut demonstrations)?;
        }
        watch.add(&simulator.take_watch());
        drop(simulator);
        // They train policies. What is collected for AIPs is counted apart.
        self.timesheet.note(Activity::Training, begun.elapsed(), &watch);
        Ok(demonstrations)
    }

    /// Makes the policies of this worker's agents imitate their demonstrations.
    pub fn imitate(&mut self, demonstrations: Vec<Demonstrations>, observer: &dyn Observer) -> Vec<ImitationLoss> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let count = self.blocks.len() as f64;
        let mut losses = Vec::new();
        let demonstrations = self.by_block(demonstrations);
        for (done, (block, demonstrations)) in self.blocks.iter_mut().zip(&demonstrations).enumerate() {
            let progress = &mut |share| observer.busy(Activity::Training, (done as f64 + share) / count);
            losses.extend(block.imitate(demonstrations, Work { watch: &mut watch, progress }));
        }
        self.timesheet.note(Activity::Training, begun.elapsed(), &watch);
        self.in_order(losses)
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
        self.on_the_gs(Activity::Evaluation, policies, episodes, observer, |simulator, controller, episode| {
            reports.push(play(simulator, controller, episode_seed(seed, episode))?);
            Ok(())
        })?;
        Ok(reports)
    }

    /// Trains the AIPs of this worker's agents; `datasets`: those of these agents.
    pub fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period, observer: &dyn Observer) -> Vec<AipLoss> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let count = self.blocks.len() as f64;
        let mut losses = Vec::new();
        let datasets = self.by_block(datasets);
        for (done, (block, datasets)) in self.blocks.iter_mut().zip(&datasets).enumerate() {
            let progress = &mut |share| observer.busy(Activity::AipTraining, (done as f64 + share) / count);
            losses.extend(block.train_aips(datasets, period, Work { watch: &mut watch, progress }));
        }
        self.timesheet.note(Activity::AipTraining, begun.elapsed(), &watch);
        self.in_order(losses)
    }

    /// Measures the loss of the AIPs of this worker's agents; `datasets`: those of these agents.
    pub fn measure_aips(&mut self, datasets: Vec<Dataset>) -> Vec<FreshLoss> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let mut losses = Vec::new();
        for (block, datasets) in self.blocks.iter().zip(&self.by_block(datasets)) {
            losses.extend(block.measure_aips(datasets, &mut watch));
        }
        self.timesheet.note(Purpose::Measuring.activity(&self.config), begun.elapsed(), &watch);
        self.in_order(losses)
    }

    /// Returns what the influence predictors of its agents have learnt, one row each.
    pub fn aips(&self) -> Ragged<f32> {
        self.joined(AgentBlock::aips)
    }

    /// Returns the policies of its agents, one row each.
    pub fn policies(&self) -> JointPolicy {
        self.joined(AgentBlock::policies)
    }

    /// Joins a table of every block into one of its agents.
    fn joined(&self, table: impl Fn(&AgentBlock) -> Ragged<f32>) -> Ragged<f32> {
        let mut joined = Ragged::default();
        self.blocks.iter().for_each(|block| joined.extend(&table(block)));
        match self.order() {
            Some(order) => joined.pick(order),
            None => joined,
        }
    }

    /// Trains the policies of its agents until the end of the period, block after block, or all at once on the GS.
    pub fn train_policies(&mut self, period: &Period, observer: &dyn Observer) -> Result<PolicyTraining> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let count = self.blocks.len() as u64;
        let mut parts = Vec::new();
        if self.config.simulator == Simulator::Global {
            let (domain, config, progress) = (&*self.domain, &self.config, &mut |steps| observer.trained(steps));
            parts = train_policies_on_the_gs(
                domain,
                config,
                &mut self.blocks,
                period,
                Work { watch: &mut watch, progress },
            )?;
        } else {
            for (done, block) in (0..).zip(&mut self.blocks) {
                // The mean over all agents.
                let average = |steps| (done * period.end + steps + (count - done - 1) * period.start) / count;
                let progress = &mut |steps| observer.trained(average(steps));
                parts.push(block.train_policies(period, Work { watch: &mut watch, progress })?);
            }
        }
        self.timesheet.note(Activity::Training, begun.elapsed(), &watch);
        let training = PolicyTraining::joined(parts);
        Ok(PolicyTraining { agents: self.in_order(training.agents), ..training })
    }

    /// Lets all agents' policies act on the GS, in episodes that `play` plays one by one.
    fn on_the_gs(
        &mut self,
        activity: Activity,
        policies: &JointPolicy,
        episodes: Range<usize>,
        observer: &dyn Observer,
        mut play: impl FnMut(&mut dyn GlobalSimulator, &mut dyn Controller, usize) -> Result<()>,
    ) -> Result<()> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let mut simulator = Timed::new(watch.time(Phase::Loading, || self.domain.global_simulator())?);
        let (kinds, config) = (self.domain.kinds(), &self.config.policy);
        let mut controller =
            TimedController::new(JointPolicyController::new(kinds, config, policies, Selection::Sampled));
        let mut telling = Telling::new(&mut controller, observer, activity, episodes.len() * kinds.horizon());
        episodes.into_iter().try_for_each(|episode| play(&mut simulator, &mut telling, episode))?;
        watch.add(&simulator.take_watch());
        watch.add(&controller.watch);
        drop(simulator);
        self.timesheet.note(activity, begun.elapsed(), &watch);
        Ok(())
    }
}
