//! A worker: a share of the agents for the whole run, with all that belongs to them.
//!
//! Its [`AgentBlock`]s hold policies, AIPs and optimisers. Local simulators exist only during a period, because libsumo
//! holds one simulation per process, and between periods the worker runs the GS. A period begins where [`AgentsState`]
//! left the one before it, down to the cars on the road.

pub mod block;
pub(crate) mod watched;

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;

use crate::config::Config;
use crate::environments::makers::{InThisProcess, MakeSimulators};
use crate::observer::Observer;
use crate::policy::{JointPolicy, JointPolicyController, Selection};
use crate::state::AgentsState;
use crate::worker::block::{AgentBlock, agents_per_block};
use crate::worker::watched::Watched;
use dials_core::base::{Activity, AgentId, Phase, Ragged, Stopwatch, Timesheet, Work};
use dials_core::domain::{Controller, Domain, GlobalSimulator, Result};
use stacknets::Threads;

pub struct Worker {
    pub(crate) domain: Arc<dyn Domain>,
    pub(crate) config: Config,
    pub(crate) blocks: Vec<AgentBlock>,
    /// Makes simulators that this process cannot hold, too.
    pub(crate) makers: Box<dyn MakeSimulators>,
    /// Places of the agents of every block among those of the worker: a block has agents of one kind.
    places: Vec<Vec<usize>>,
    /// Policies of all agents, with which the next step plays episodes.
    joint: Option<JointPolicy>,
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
            makers: Box::new(InThisProcess),
            joint: None,
            config: config.clone(),
            domain,
            timesheet: Timesheet::default(),
        }
    }

    /// Lets others make simulators that this process cannot hold, too.
    pub fn with_makers(self, makers: Box<dyn MakeSimulators>) -> Self {
        Worker { makers, ..self }
    }

    pub fn state(&self) -> AgentsState {
        let joined = AgentsState::joined(self.blocks.iter().map(AgentBlock::state).collect());
        match self.order() {
            Some(order) => joined.share(order),
            None => joined,
        }
    }

    pub fn restore(&mut self, state: &AgentsState) {
        for (block, places) in self.blocks.iter_mut().zip(&self.places) {
            block.restore(state.share(places.iter().copied()));
        }
    }

    /// Returns the place of each of its agents when the blocks are put one after another; `None` if that is its own
    /// order.
    pub(crate) fn order(&self) -> Option<Vec<usize>> {
        let places = self.places.concat();
        let mut order: Vec<usize> = (0..places.len()).collect();
        order.sort_by_key(|&index| places[index]);
        (!places.is_sorted()).then_some(order)
    }

    /// Returns a thing for each block, made from the places of its agents.
    pub(crate) fn by_block<T>(&self, make: impl Fn(&[usize]) -> T) -> Vec<T> {
        self.places.iter().map(|places| make(places)).collect()
    }

    /// Puts the results of its agents, block after block, into their own order.
    pub(crate) fn in_order<T>(&self, by_block: Vec<T>) -> Vec<T> {
        let mut with_places: Vec<(usize, T)> = self.places.iter().flatten().copied().zip(by_block).collect();
        with_places.sort_by_key(|&(place, _)| place);
        with_places.into_iter().map(|(_, of_agent)| of_agent).collect()
    }

    /// Lets every block work on what is given to its agents. Returns one result per agent. Both are in their order.
    pub(crate) fn in_blocks<D, T>(
        &mut self,
        activity: Activity,
        of_agents: Vec<D>,
        observer: &dyn Observer,
        mut work: impl FnMut(&mut AgentBlock, &[D], Work<'_, f64>) -> Vec<T>,
    ) -> Vec<T> {
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let mut of_agents: Vec<Option<D>> = of_agents.into_iter().map(Some).collect();
        let mut take = |&place: &usize| of_agents[place].take().expect("an agent is in one block");
        let count = self.blocks.len() as f64;
        let mut results = Vec::new();
        for (done, (block, places)) in self.blocks.iter_mut().zip(&self.places).enumerate() {
            let of_block: Vec<D> = places.iter().map(&mut take).collect();
            let progress = &mut |share| observer.busy(activity, (done as f64 + share) / count);
            results.extend(work(block, &of_block, Work { watch: &mut watch, progress }));
        }
        self.timesheet.note(activity, begun.elapsed(), &watch);
        self.in_order(results)
    }

    pub fn take_timesheet(&mut self) -> Timesheet {
        self.timesheet.take()
    }

    /// Takes the policies of all agents, with which the next step plays episodes.
    pub fn take_policies(&mut self, joint: JointPolicy) {
        self.joint = Some(joint);
    }

    pub(crate) fn note(&mut self, activity: Activity, whole: std::time::Duration, phases: &Stopwatch) {
        self.timesheet.note(activity, whole, phases);
    }

    pub fn aips(&self) -> Ragged<f32> {
        self.joined(AgentBlock::aips)
    }

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

    /// Lets the policies that [`Worker::take_policies`] got act on the GS, in episodes that `play` plays one by one.
    pub(crate) fn on_the_gs(
        &mut self,
        activity: Activity,
        episodes: Range<usize>,
        observer: &dyn Observer,
        mut play: impl FnMut(&mut dyn GlobalSimulator, &mut dyn Controller, usize) -> Result<()>,
    ) -> Result<()> {
        let policies = self.joint.take().context("no policies were sent before this step")?;
        let (begun, mut watch) = (Instant::now(), Stopwatch::default());
        let mut simulator = watch.time(Phase::Loading, || self.domain.global_simulator())?;
        let (kinds, config) = (self.domain.kinds(), &self.config);
        let mut controller = JointPolicyController::new(kinds, config, &policies, Selection::Sampled);
        let mut controller = Watched::new(&mut controller, observer, activity, episodes.len() * kinds.horizon());
        episodes.into_iter().try_for_each(|episode| play(&mut *simulator, &mut controller, episode))?;
        controller.add_to(&mut watch, &mut *simulator);
        drop(simulator);
        self.timesheet.note(activity, begun.elapsed(), &watch);
        Ok(())
    }
}
