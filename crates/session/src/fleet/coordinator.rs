//! The coordinator of workers that share the agents: which worker owns which agents, orders, deaths and patience.
//!
//! # Why not otherwise
//!
//! **Why does each worker own a block of agents, and not take the next free one from a queue?** A queue keeps all
//! workers busy. But the local simulators of a worker are one SUMO net, made for its agents, and loading another one
//! takes time, too. On a grid all agents cost about the same, so blocks of equal length end at about the same time.
//!
//! **Why does a result not depend on the number of workers?** Every agent has random streams of its own, which come and
//! go with its state. Sums are taken agent by agent, and replies are put together in the order of the agents, whoever
//! comes first. So a worker is a place, and never a part of the computation.
//!
//! **Why is the state of all agents kept here?** A worker that dies takes its memory along. The state of the last
//! exchange is enough to give its order to another process, which computes the same bits. A worker that wrote its own
//! checkpoints would save this memory. But then a resumed run would have to put together files of different times.

use std::collections::BTreeMap;
use std::ops::Range;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use super::channel::encode;
use super::link::{Crew, Frame, Link, Loss, News};
use super::message::{Order, WorkerReport};
use super::process::{CpuClock, Growth, MostGrowth, footprint};
use super::shares::{agents_of_workers, names_of, share};
use super::task::{Task, report_progress};
use crate::config::RunConfig;
use dials_core::base::{Activity, AgentId};
use dials_core::domain::Domain;
use dials_learn::config::Config;
use dials_learn::fleet::{Fleet, FleetLoad, Stop, WorkerLoad};
use dials_learn::observer::{Interrupted, Observer};
use dials_learn::state::AgentsState;
use dials_learn::state::fits::{Fit, Widths};
use dials_learn::steps::{ReportState, Step};

/// Number of times that a worker may be lost at the same order before the run gives up.
const DEATHS_IN_A_ROW: usize = 3;
/// Interval at which the fleet checks its workers while it waits.
const LOOK_UP: Duration = Duration::from_millis(200);
/// Longest silence that one check adds. While the coordinator itself was stopped (Ctrl-Z), it could hear nobody.
const LONGEST_LOOK: Duration = Duration::from_secs(1);

pub struct Options {
    pub workers: usize,
    /// Number of threads of a worker that trains all agents alone.
    pub threads: usize,
    /// Longest silence of a worker that has an order, whether it does not read the order or hangs at work.
    pub patience: Duration,
    /// Growth at which a worker that can be replaced is replaced.
    pub most_growth: MostGrowth,
    /// What the workers need to make local simulators ([`Domain::prepare`]).
    pub prepared: Option<Vec<u8>>,
}

/// Workers that share the agents: each owns a block of consecutive agents, in the order of the workers. A
/// [`Fleet`](dials_learn::fleet::Fleet), whatever its crew consists of.
/// On the GS, and where agents share a policy, the first worker trains all agents with several threads; the others help to
/// evaluate.
pub struct Coordinator {
    domain: Arc<dyn Domain>,
    config: RunConfig,
    /// Sizes of what the workers say.
    widths: Widths,
    crew: Box<dyn Crew>,
    options: Options,
    observer: Rc<dyn Observer>,
    workers: Vec<Slot>,
    /// Agents at the last exchange, from which a lost worker continues.
    agents: AgentsState,
    at_work: Duration,
    clock: CpuClock,
}

/// A worker, whichever process it is at the moment.
struct Slot {
    agents: Range<usize>,
    link: Option<Box<dyn Link>>,
    growth: Growth,
    load: WorkerLoad,
}

impl Coordinator {
    pub fn start(
        domain: Arc<dyn Domain>,
        config: &RunConfig,
        crew: Box<dyn Crew>,
        options: Options,
        observer: Rc<dyn Observer>,
    ) -> Result<Coordinator> {
        let slot = |agents| Slot { agents, link: None, growth: Growth::default(), load: WorkerLoad::default() };
        let mut fleet = Coordinator {
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
        let parts = fleet.ask_owners(Activity::Training, Stop::AtOnce, |_| ReportState, |_, _, state| state)?;
        fleet.agents = AgentsState::joined(parts);
        Ok(fleet)
    }

    fn owners(&self) -> Vec<usize> {
        (0..self.workers.len()).filter(|&worker| !self.workers[worker].agents.is_empty()).collect()
    }

    /// Gives the tasks to their workers and waits for all replies. Lost workers are started again.
    /// `take` gets every reply with the state of all agents and the agents of the worker, in any order. Returns what it
    /// returned, in the order of the workers.
    fn ask<S: Step, T>(
        &mut self,
        tasks: Vec<(usize, Task<S::Reply>)>,
        stop: Stop,
        mut take: impl FnMut(&mut AgentsState, Range<usize>, S::Reply) -> T,
    ) -> Result<Vec<T>> {
        if self.observer.stop_requested() {
            return Err(Interrupted.into()); // Nothing has begun.
        }
        let begun = Instant::now();
        let mut taken = BTreeMap::new();
        let mut take = |fleet: &mut Self, worker: usize, reply| {
            let agents = fleet.workers[worker].agents.clone();
            taken.insert(worker, take(&mut fleet.agents, agents, reply));
        };
        let mut open = BTreeMap::new();
        let asked = tasks.len();
        for (worker, mut task) in tasks {
            self.deliver(worker, &mut task)?;
            open.insert(worker, task);
        }
        let mut replies = BTreeMap::new();
        let mut looked = Instant::now();
        while !open.is_empty() {
            self.crew.wait(LOOK_UP);
            let silence = looked.elapsed().min(LONGEST_LOOK);
            looked = Instant::now();
            open.values_mut().for_each(|task| task.silence += silence);
            // All messages are read before any worker counts as silent.
            for worker in 0..self.workers.len() {
                while let Some(news) = self.workers[worker].link.as_mut().and_then(|link| link.next()) {
                    let done = asked - open.len();
                    if let Some(reply) = self.take_in::<S>(worker, news, &mut open, done)? {
                        replies.insert(worker, reply);
                    }
                }
                // A worker that can be replaced continues from the state of the last exchange, so that must stay. Without
                // that, no reply has to wait for the others, and memory holds only one of them.
                if !self.crew.can_replace() {
                    replies.remove(&worker).into_iter().for_each(|reply| take(self, worker, reply));
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
        self.at_work += begun.elapsed();
        // One by one, so that each is freed before the next is processed.
        for (worker, reply) in replies {
            take(self, worker, reply);
        }
        Ok(taken.into_values().collect())
    }

    /// Processes news of a worker. Returns its reply if that is complete.
    fn take_in<S: Step>(
        &mut self,
        worker: usize,
        news: News,
        open: &mut BTreeMap<usize, Task<S::Reply>>,
        done: usize,
    ) -> Result<Option<S::Reply>> {
        let lost = match news {
            News::Said(WorkerReport::Failed { reason }) => bail!("{}{reason}", self.prefix(worker)),
            News::Said(report) => match self.hear::<S>(worker, report, open, done) {
                Ok(reply) => {
                    if reply.is_some() {
                        open.remove(&worker);
                    }
                    return Ok(reply);
                }
                Err(reason) => Loss::Nonsense(reason),
            },
            News::Gone(reason) => Loss::Gone(reason),
        };
        self.lose(worker, lost, open.get_mut(&worker)).map(|()| None)
    }

    /// Processes a message of a worker; returns its reply if it is one. An error: it cannot be right.
    fn hear<S: Step>(
        &mut self,
        worker: usize,
        report: WorkerReport,
        open: &mut BTreeMap<usize, Task<S::Reply>>,
        done: usize,
    ) -> Result<Option<S::Reply>> {
        let task = open.get_mut(&worker);
        let most_steps =
            task.as_ref().and_then(|task| task.trains_until).map(|end| self.config.learning.update_at_or_after(end));
        report.check(most_steps)?;
        if let WorkerReport::Done { reply, load, resident_kib } = report {
            let task = task.context("it answered without an order")?;
            let reply = S::reply(*reply).context("it answered another order than the one it has")?;
            (task.check)(&reply, &self.fit(worker))?;
            let Slot { load: mine, growth, .. } = &mut self.workers[worker];
            growth.note(resident_kib);
            mine.timesheet.add(&load.timesheet);
            mine.footprint = mine.footprint.max(load.footprint);
            return Ok(Some(reply));
        }
        if let Some(task) = task {
            task.silence = Duration::ZERO;
            if !matches!(report, WorkerReport::Begun) {
                task.progress = Some(report);
                report_progress(open.values(), done, &*self.observer);
            }
        }
        Ok(None)
    }

    /// Returns what the replies of a worker are checked by.
    fn fit(&self, worker: usize) -> Fit<'_> {
        let agents = self.workers[worker].agents.clone();
        Fit { config: &self.config.learning, kinds: self.domain.kinds(), widths: &self.widths, agents }
    }

    /// Sends a task to its worker, which is started first if it is not running. Does not wait for the worker.
    fn deliver<Reply>(&mut self, worker: usize, task: &mut Task<Reply>) -> Result<()> {
        if self.workers[worker].link.is_none() {
            self.start_worker(worker)?;
        }
        task.silence = Duration::ZERO;
        task.send(&**self.workers[worker].link.as_ref().expect("it was just started"));
        Ok(())
    }

    /// Starts a worker and gives it the state of its agents at the last exchange.
    fn start_worker(&mut self, worker: usize) -> Result<()> {
        let link = self.crew.start(worker)?;
        let agents = self.workers[worker].agents.clone();
        let begin = Order::Begin {
            config_json: serde_json::to_string(&self.config)?,
            agents: agents.map(AgentId).collect(),
            threads: if self.config.learning.learns_at_one_place() { self.options.threads } else { 1 },
            prepared: self.options.prepared.clone(),
        };
        link.send(encode(&begin)?.into());
        self.send_state(worker, &*link)?;
        let slot = &mut self.workers[worker];
        (slot.link, slot.growth) = (Some(link), Growth::default());
        Ok(())
    }

    fn send_state(&self, worker: usize, link: &dyn Link) -> Result<()> {
        let agents = self.workers[worker].agents.clone();
        if self.agents.agents() > 0 && !agents.is_empty() {
            link.send(encode(&Order::Restore(self.agents.share(agents)))?.into());
        }
        Ok(())
    }

    /// Makes the workers that run continue from the present state of their agents.
    fn send_states(&self) -> Result<()> {
        for worker in self.owners() {
            if let Some(link) = &self.workers[worker].link {
                self.send_state(worker, &**link)?;
            }
        }
        Ok(())
    }

    /// Handles the loss of a worker, or ends it. If it can be replaced, and has a task, another one gets the task.
    fn lose<Reply>(&mut self, worker: usize, loss: Loss, task: Option<&mut Task<Reply>>) -> Result<()> {
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

    /// Returns the beginning of an error of a worker: its name, if there are others.
    fn prefix(&self, worker: usize) -> String {
        if self.crew.is_this_process() { String::new() } else { format!("{}: ", self.name(worker)) }
    }

    fn encoded_policies(&mut self) -> Result<Frame> {
        // Lent and not copied: with a thousand agents the copy would be a fifth of this process.
        let order = Order::TakePolicies(std::mem::take(&mut self.agents.policies));
        let encoded = encode(&order);
        if let Order::TakePolicies(policies) = order {
            self.agents.policies = policies;
        }
        Ok(encoded?.into())
    }
}

impl Fleet for Coordinator {
    fn config(&self) -> &Config {
        &self.config.learning
    }

    fn domain(&self) -> &dyn Domain {
        &*self.domain
    }

    fn agents(&self) -> &AgentsState {
        &self.agents
    }

    fn restore(&mut self, agents: AgentsState) -> Result<()> {
        self.agents = agents;
        if !self.crew.can_replace() {
            return self.send_states();
        }
        // The next step starts them again, in this state.
        self.owners().into_iter().for_each(|worker| self.workers[worker].link = None);
        Ok(())
    }

    fn change(&mut self, change: impl FnOnce(&mut AgentsState)) -> Result<()> {
        change(&mut self.agents);
        self.send_states()
    }

    fn keep_outside_aips(&mut self, state: Vec<u8>) {
        self.agents.outside_aips = state;
    }

    fn ask_all<S: Step>(
        &mut self,
        activity: Activity,
        episodes: usize,
        with_policies: bool,
        mut step: impl FnMut(Range<usize>) -> S,
    ) -> Result<Vec<S::Reply>> {
        self.observer.busy(activity, 0.0);
        let policies = if with_policies { Some(self.encoded_policies()?) } else { None };
        let workers = self.workers.len();
        let shares = (0..workers).map(|worker| (worker, share(episodes, workers, worker)));
        let task = |(worker, share)| Ok((worker, Task::of(step(share), policies.clone())?));
        let tasks = shares.filter(|(_, share)| !share.is_empty()).map(task).collect::<Result<_>>()?;
        self.ask::<S, _>(tasks, Stop::AtOnce, |_, _, reply| reply)
    }

    fn ask_owners<S: Step, T>(
        &mut self,
        activity: Activity,
        stop: Stop,
        mut step: impl FnMut(Range<usize>) -> S,
        take: impl FnMut(&mut AgentsState, Range<usize>, S::Reply) -> T,
    ) -> Result<Vec<T>> {
        self.observer.busy(activity, 0.0);
        let task = |worker: usize| Ok((worker, Task::of(step(self.workers[worker].agents.clone()), None)?));
        let tasks = self.owners().into_iter().map(task).collect::<Result<_>>()?;
        self.ask::<S, _>(tasks, stop, take)
    }

    /// Ends the workers that have grown too much. The next order starts them again.
    fn period_done(&mut self) {
        if self.crew.can_replace() {
            let most = self.options.most_growth;
            let grown = self.workers.iter_mut().filter_map(|slot| slot.growth.is_too_much(most).then_some(slot));
            grown.for_each(|slot| slot.link = None);
        }
    }

    fn take_load(&mut self) -> FleetLoad {
        let workers = self
            .workers
            .iter_mut()
            .map(|slot| WorkerLoad { timesheet: slot.load.timesheet.take(), footprint: slot.load.footprint });
        let (workers, at_work) = (workers.collect(), std::mem::take(&mut self.at_work));
        if self.crew.is_this_process() {
            return FleetLoad { workers, at_work, ..FleetLoad::default() };
        }
        FleetLoad { workers, at_work, coordinator: Some(footprint()), coordinator_cpu: self.clock.lap() }
    }
}
