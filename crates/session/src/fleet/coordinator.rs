//! The coordinator of workers that share the agents: which worker owns which agents, orders, deaths and patience.

use std::collections::BTreeMap;
use std::ops::Range;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use super::channel::encode;
use super::expected::Speaker;
use super::footprint::CpuClock;
use super::growth::{Growth, MostGrowth};
use super::link::{Crew, Link, News};
use super::loss::Loss;
use super::message::{Answer, Order, WorkerReport};
use super::shares::{agents_of_workers, names_of};
use super::task::{Frames, Task, tell_progress};
use crate::config::RunConfig;
use dials_core::base::AgentId;
use dials_core::domain::Domain;
use dials_learn::config::Simulator;
use dials_learn::training::answers::WorkerLoad;
use dials_learn::training::fits::{Fit, Widths};
use dials_learn::training::observer::{Interrupted, Observer};
use dials_learn::training::state::AgentsState;

/// Number of times that a worker may be lost at the same order before the run gives up.
const DEATHS_IN_A_ROW: usize = 3;
/// Interval at which the fleet checks its workers while it waits.
const LOOK_UP: Duration = Duration::from_millis(200);
/// Longest silence that one check adds. While the coordinator itself was stopped (Ctrl-Z), it could hear nobody.
const LONGEST_LOOK: Duration = Duration::from_secs(1);

/// Number of workers, and how long they may be silent.
pub struct Options {
    pub workers: usize,
    /// Number of threads with which a single worker trains on the GS.
    pub threads: usize,
    /// Longest silence of a worker that has an order, whether it does not read the order or hangs at work.
    pub patience: Duration,
    /// Growth at which a worker that can be replaced is replaced.
    pub most_growth: MostGrowth,
}

/// Workers that share the agents: each owns a block of consecutive agents, in the order of the workers. A
/// [`Fleet`](dials_learn::training::fleet::Fleet), whatever its crew consists of.
///
/// Training on the global simulator (GS) is one simulation. So there the first worker owns all agents and trains them
/// with several threads; the others help with evaluation.
pub struct Coordinator<C: Crew> {
    pub(super) domain: Arc<dyn Domain>,
    pub(super) config: RunConfig,
    /// Sizes of what the workers say.
    widths: Widths,
    crew: C,
    options: Options,
    pub(super) observer: Rc<dyn Observer>,
    pub(super) workers: Vec<Slot<C::Link>>,
    /// Agents at the last exchange, from which a lost worker continues.
    pub(super) agents: AgentsState,
    pub(super) at_work: Duration,
    pub(super) clock: CpuClock,
    /// What the workers need to make local simulators, made once for all of them.
    prepared: Option<Vec<u8>>,
}

/// A worker, whichever process it is at the moment.
pub(super) struct Slot<L> {
    pub agents: Range<usize>,
    link: Option<L>,
    /// Growth of this process.
    growth: Growth,
    pub load: WorkerLoad,
}

impl<C: Crew> Coordinator<C> {
    /// Starts the workers.
    pub fn start(
        domain: Arc<dyn Domain>,
        config: &RunConfig,
        crew: C,
        options: Options,
        observer: Rc<dyn Observer>,
    ) -> Result<Coordinator<C>> {
        let slot = |agents| Slot { agents, link: None, growth: Growth::default(), load: WorkerLoad::default() };
        let prepared = if config.learning.simulator == Simulator::Global { None } else { domain.prepare()? };
        let mut fleet = Coordinator {
            prepared,
            workers: agents_of_workers(&config.learning, domain.agents(), options.workers)
                .into_iter()
                .map(slot)
                .collect(),
            agents: AgentsState::nobody(),
            widths: Widths::of(&config.learning, domain.kinds()),
            domain,
            config: config.clone(),
            crew,
            options,
            observer,
            at_work: Duration::ZERO,
            clock: CpuClock::from_now(),
        };
        let order = Frames::of(&Order::TellState)?;
        let orders = fleet.owners().into_iter().map(|worker| (worker, order.clone())).collect();
        let parts = fleet.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::State(state) => state,
            other => unreachable!("`expected` lets only a state pass, not {other:?}"),
        })?;
        fleet.agents = AgentsState::joined(parts);
        Ok(fleet)
    }

    /// Returns the workers that own agents.
    pub(super) fn owners(&self) -> Vec<usize> {
        (0..self.workers.len()).filter(|&worker| !self.workers[worker].agents.is_empty()).collect()
    }

    /// Gives the orders and waits for all answers. Lost workers are started again.
    ///
    /// `take` gets every answer with the state of all agents and the agents of the worker, in any order. Returns what it
    /// returned, in the order of the workers.
    pub(super) fn ask<T>(
        &mut self,
        orders: Vec<(usize, Frames)>,
        stop: Stop,
        mut take: impl FnMut(&mut AgentsState, Range<usize>, Answer) -> T,
    ) -> Result<Vec<T>> {
        let begun = Instant::now();
        let mut taken = BTreeMap::new();
        let mut take = |fleet: &mut Self, worker: usize, answer| {
            let agents = fleet.workers[worker].agents.clone();
            taken.insert(worker, take(&mut fleet.agents, agents, answer));
        };
        let answers = self.ask_and_wait(orders, stop, &mut take);
        self.at_work += begun.elapsed();
        // One by one, so that each is freed before the next is processed.
        for (worker, answer) in answers? {
            take(self, worker, answer);
        }
        Ok(taken.into_values().collect())
    }

    /// Returns the answers that `take` has not got yet.
    fn ask_and_wait(
        &mut self,
        orders: Vec<(usize, Frames)>,
        stop: Stop,
        take: &mut impl FnMut(&mut Self, usize, Answer),
    ) -> Result<BTreeMap<usize, Answer>> {
        let mut open = BTreeMap::new();
        let asked = orders.len();
        for (worker, frames) in orders {
            let mut task = Task::new(frames);
            self.deliver(worker, &mut task)?;
            open.insert(worker, task);
        }
        let mut answers = BTreeMap::new();
        let mut looked = Instant::now();
        while !open.is_empty() {
            self.crew.wait(LOOK_UP);
            let silence = looked.elapsed().min(LONGEST_LOOK);
            looked = Instant::now();
            open.values_mut().for_each(|task| task.silence += silence);
            // All messages are read before any worker counts as silent.
            for worker in 0..self.workers.len() {
                while let Some(news) = self.workers[worker].link.as_mut().and_then(Link::next) {
                    let done = asked - open.len();
                    if let Some(answer) = self.take_in(worker, news, &mut open, done)? {
                        answers.insert(worker, answer);
                    }
                }
                // A worker that can be replaced continues from the state of the last exchange, so that must stay. Without
                // that, no answer has to wait for the others, and memory holds only one of them.
                if !self.crew.can_replace() {
                    answers.remove(&worker).into_iter().for_each(|answer| take(self, worker, answer));
                }
            }
            for (&worker, task) in &mut open {
                if task.silence > self.options.patience {
                    self.lose(worker, Loss::Silent, Some(task))?;
                }
            }
            // After the news, because whatever ended a worker may also have asked this process to stop.
            let anywhere = stop == Stop::AtOnce || !self.observer.keeps_results();
            if anywhere && !open.is_empty() && self.observer.stop_requested() {
                return Err(Interrupted.into());
            }
        }
        Ok(answers)
    }

    /// Processes news of a worker. Returns its answer if that is complete.
    fn take_in(
        &mut self,
        worker: usize,
        news: News,
        open: &mut BTreeMap<usize, Task>,
        done: usize,
    ) -> Result<Option<Answer>> {
        let lost = match news {
            News::Said(report) => match self.check(worker, &report, open) {
                Ok(()) => {
                    let answer = self.hear(worker, report, open, done)?;
                    if answer.is_some() {
                        open.remove(&worker);
                    }
                    return Ok(answer);
                }
                Err(reason) => Loss::Nonsense(reason),
            },
            News::Gone(reason) => Loss::Gone(reason),
        };
        self.lose(worker, lost, open.get_mut(&worker)).map(|()| None)
    }

    /// Returns an error if a message of a worker cannot be right.
    fn check(&self, worker: usize, report: &WorkerReport, open: &BTreeMap<usize, Task>) -> Result<()> {
        let agents = self.workers[worker].agents.clone();
        let fit = Fit { config: &self.config.learning, kinds: self.domain.kinds(), widths: &self.widths, agents };
        Speaker(fit).check(report, open.get(&worker).map(|task| task.frames.expected))
    }

    /// Processes a message of a worker; returns its answer if it is one.
    fn hear(
        &mut self,
        worker: usize,
        report: WorkerReport,
        open: &mut BTreeMap<usize, Task>,
        done: usize,
    ) -> Result<Option<Answer>> {
        if let Some(task) = open.get_mut(&worker) {
            task.silence = Duration::ZERO;
        }
        match report {
            WorkerReport::Failed { reason } => bail!("{}: {reason}", self.name(worker)),
            WorkerReport::Done { answer, load, resident_kib } => {
                let Slot { load: mine, growth, .. } = &mut self.workers[worker];
                growth.note(resident_kib);
                mine.timesheet.add(&load.timesheet);
                mine.footprint = mine.footprint.max(load.footprint);
                // A worker that has begun or was restored says so before it starts its order.
                Ok(Some(*answer).filter(|answer| !matches!(answer, Answer::Ready)))
            }
            progress => {
                if let Some(task) = open.get_mut(&worker) {
                    task.progress = Some(progress);
                    tell_progress(open.values(), done, &*self.observer);
                }
                Ok(None)
            }
        }
    }

    /// Sends a task to its worker, which is started first if it is not running. Does not wait for the worker.
    fn deliver(&mut self, worker: usize, task: &mut Task) -> Result<()> {
        if self.workers[worker].link.is_none() {
            self.start_worker(worker)?;
        }
        task.silence = Duration::ZERO;
        task.frames.send(self.workers[worker].link.as_ref().expect("it was just started"));
        Ok(())
    }

    /// Starts a worker and gives it the state of its agents at the last exchange.
    fn start_worker(&mut self, worker: usize) -> Result<()> {
        let link = self.crew.start(worker)?;
        let agents = self.workers[worker].agents.clone();
        let begin = Order::Begin {
            config_json: serde_json::to_string(&self.config)?,
            agents: agents.map(AgentId).collect(),
            threads: if self.config.learning.simulator == Simulator::Global { self.options.threads } else { 1 },
            prepared: self.prepared.clone(),
        };
        link.send(encode(&begin)?.into());
        self.send_state(worker, &link)?;
        let slot = &mut self.workers[worker];
        (slot.link, slot.growth) = (Some(link), Growth::default());
        Ok(())
    }

    /// Sends a worker the state of its agents, if there is one.
    fn send_state(&self, worker: usize, link: &C::Link) -> Result<()> {
        let agents = self.workers[worker].agents.clone();
        if self.agents.agents() > 0 && !agents.is_empty() {
            link.send(encode(&Order::Restore(self.agents.share(agents)))?.into());
        }
        Ok(())
    }

    /// Makes all workers continue from a state of all agents.
    pub(super) fn put_back(&mut self, agents: AgentsState) -> Result<()> {
        self.agents = agents;
        if !self.crew.can_replace() {
            return self.send_states();
        }
        // The next order starts them again, in this state.
        self.owners().into_iter().for_each(|worker| self.workers[worker].link = None);
        Ok(())
    }

    /// Makes the workers that run continue from the present state of their agents.
    pub(super) fn send_states(&self) -> Result<()> {
        for worker in self.owners() {
            if let Some(link) = &self.workers[worker].link {
                self.send_state(worker, link)?;
            }
        }
        Ok(())
    }

    /// Ends the workers that have grown too much in a period whose end this is. The next order starts them again.
    pub(super) fn end_those_that_grew(&mut self) {
        if self.crew.can_replace() {
            let most = self.options.most_growth;
            let grown = self.workers.iter_mut().filter_map(|slot| slot.growth.is_too_much(most).then_some(slot));
            grown.for_each(|slot| slot.link = None);
        }
    }

    /// Handles the loss of a worker, or ends a worker. With a task it is started again, if it can be, and gets the task
    /// again.
    fn lose(&mut self, worker: usize, loss: Loss, task: Option<&mut Task>) -> Result<()> {
        let Some(link) = self.workers[worker].link.take() else { return Ok(()) };
        let message = format!("{} {}", self.name(worker), loss.describe(link, self.options.patience));
        if !self.crew.can_replace() {
            bail!("{message}\na worker of this kind cannot be started again, so the run ends here");
        }
        let Some(task) = task else {
            // It has no order: the next order starts it again.
            self.observer.worker_lost(&message);
            return Ok(());
        };
        task.deaths += 1;
        if task.deaths == DEATHS_IN_A_ROW {
            bail!("{message}\ngave up after {DEATHS_IN_A_ROW} deaths in a row at the same place");
        }
        self.observer.worker_lost(&format!("{message}\nstarted again from the last exchange"));
        self.deliver(worker, task)
    }

    fn name(&self, worker: usize) -> String {
        names_of(worker, &self.workers[worker].agents)
    }
}

/// When a request to stop takes effect.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Stop {
    /// At once, because nothing is lost.
    AtOnce,
    /// Later, because a period's work would be lost.
    Later,
}
