//! The fleet of worker processes, seen from the coordinator.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use super::channel::encode;
use super::child::{Child, Event, Frame, What};
use super::message::{Answer, Order, Report};
use crate::base::{Activity, AgentId};
use crate::config::{Config, Period, SimulatorKind};
use crate::domain::Domain;
use crate::evaluation::Evaluation;
use crate::influence::{AipLoss, Dataset, FreshLoss};
use crate::training::answers::{FleetLoad, PolicyTraining, WorkerLoad};
use crate::training::collect::Purpose;
use crate::training::fleet::Fleet;
use crate::training::footprint::{CpuClock, Footprint};
use crate::training::observer::{Interrupted, Observer};
use crate::training::state::AgentsState;

/// How often a worker may be lost at the same order before the run gives up.
const DEATHS_IN_A_ROW: usize = 3;
/// How often the fleet looks up from waiting.
const LOOK_UP: Duration = Duration::from_millis(200);
/// Longest silence that one look adds. A coordinator that was stopped itself (Ctrl-Z) has heard nobody meanwhile.
const LONGEST_LOOK: Duration = Duration::from_secs(1);

/// How many processes, and how they are kept.
pub struct Options {
    pub workers: usize,
    /// Longest silence of a worker that has an order, be it that it does not read the order or that it hangs at work.
    pub patience: Duration,
    /// For `worker_N.log`.
    pub log_dir: PathBuf,
}

/// Worker processes that share the agents: each owns the ones that follow those of the worker before it.
///
/// Training on the GS is one simulation, so there the first worker owns all agents and trains them with as many threads
/// as there are workers; the others help with evaluation.
pub struct ProcessFleet {
    domain: Arc<dyn Domain>,
    config: Config,
    options: Options,
    observer: Rc<dyn Observer>,
    workers: Vec<Slot>,
    /// The agents at the last exchange, from which a lost worker goes on.
    agents: AgentsState,
    sender: Sender<Event>,
    events: Receiver<Event>,
    at_work: Duration,
    /// The largest of this process since the last report.
    footprint: Footprint,
    clock: CpuClock,
}

/// A worker, whichever process it is at the moment.
struct Slot {
    agents: Range<usize>,
    child: Option<Child>,
    generation: u64,
    load: WorkerLoad,
}

impl ProcessFleet {
    /// Starts the workers.
    pub fn start(
        domain: Arc<dyn Domain>,
        config: &Config,
        options: Options,
        observer: Rc<dyn Observer>,
    ) -> Result<ProcessFleet> {
        let owners = if config.simulator == SimulatorKind::Gs { 1 } else { options.workers };
        let (sender, events) = channel();
        let slot = |index: usize| Slot {
            agents: if index < owners { share(domain.agents(), owners, index) } else { 0..0 },
            child: None,
            generation: 0,
            load: WorkerLoad::default(),
        };
        let mut fleet = ProcessFleet {
            workers: (0..options.workers).map(slot).collect(),
            agents: AgentsState::nobody(),
            domain,
            config: config.clone(),
            options,
            observer,
            sender,
            events,
            at_work: Duration::ZERO,
            footprint: Footprint::default(),
            clock: CpuClock::from_now(),
        };
        let order = Frames::of(&Order::TellState)?;
        let orders = fleet.owners().map(|worker| (worker, order.clone())).collect();
        let mut parts = Vec::new();
        fleet.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::State(state) => parts.push(state),
            other => unreachable!("a state was asked for, not {other:?}"),
        })?;
        fleet.agents = AgentsState::joined(parts);
        Ok(fleet)
    }

    /// The workers that own agents.
    fn owners(&self) -> impl Iterator<Item = usize> + use<> {
        let owners: Vec<usize> =
            (0..self.workers.len()).filter(|&worker| !self.workers[worker].agents.is_empty()).collect();
        owners.into_iter()
    }

    /// An order with a share of `episodes` for every worker that gets some, and the joint policy to play them with.
    fn by_episode(&self, episodes: usize, order: impl Fn(Range<usize>) -> Order) -> Result<Vec<(usize, Frames)>> {
        let policies = Frame::new(encode(&Order::TakePolicies(self.agents.policies.clone()))?);
        let shares = (0..self.workers.len()).map(|worker| (worker, share(episodes, self.workers.len(), worker)));
        let some = shares.filter(|(_, share)| !share.is_empty());
        some.map(|(worker, share)| {
            Ok((worker, Frames { before: Some(policies.clone()), order: encode(&order(share))?.into() }))
        })
        .collect()
    }

    /// An order with the datasets of its agents for every worker that owns some. `datasets`: one per agent.
    fn by_owner(
        &self,
        mut datasets: Vec<Dataset>,
        order: impl Fn(Vec<Dataset>) -> Order,
    ) -> Result<Vec<(usize, Frames)>> {
        let of_worker = |worker: usize| {
            let theirs = datasets.drain(..self.workers[worker].agents.len()).collect();
            Ok((worker, Frames::of(&order(theirs))?))
        };
        self.owners().map(of_worker).collect()
    }

    /// Gives the orders and waits for all answers, which `take` is handed in the order of the orders with the state of
    /// all agents and the agents of the worker. Lost workers are started again.
    fn ask(
        &mut self,
        orders: Vec<(usize, Frames)>,
        stop: Stop,
        mut take: impl FnMut(&mut AgentsState, Range<usize>, Answer),
    ) -> Result<()> {
        let begun = Instant::now();
        let answers = self.ask_and_wait(orders, stop);
        self.at_work += begun.elapsed();
        let footprint = Footprint::of_this_process();
        self.footprint = self.footprint.max(footprint);
        // One by one, so that each is gone before the next is taken in.
        for (worker, answer) in answers? {
            take(&mut self.agents, self.workers[worker].agents.clone(), answer);
        }
        Ok(())
    }

    fn ask_and_wait(&mut self, orders: Vec<(usize, Frames)>, stop: Stop) -> Result<Vec<(usize, Answer)>> {
        let mut open = BTreeMap::new();
        let mut sequence = Vec::new();
        for (worker, frames) in orders {
            let mut task = Task { frames, deaths: 0, silence: Duration::ZERO, progress: None };
            self.deliver(worker, &mut task)?;
            open.insert(worker, task);
            sequence.push(worker);
        }
        let mut answers = BTreeMap::new();
        let mut looked = Instant::now();
        while !open.is_empty() {
            let anywhere = stop == Stop::AtOnce || !self.observer.keeps_results();
            if anywhere && self.observer.stop_requested() {
                return Err(Interrupted.into());
            }
            let mut event = match self.events.recv_timeout(LOOK_UP) {
                Ok(event) => Some(event),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => unreachable!("the fleet holds a sender itself"),
            };
            let silence = looked.elapsed().min(LONGEST_LOOK);
            looked = Instant::now();
            open.values_mut().for_each(|task| task.silence += silence);
            // All that has been said is heard before anybody is called silent.
            while let Some(next) = event {
                self.take_in(next, &mut open, &mut answers)?;
                event = self.events.try_recv().ok();
            }
            for (&worker, task) in &mut open {
                if task.silence > self.options.patience {
                    self.lose(worker, Loss::Silent, Some(task))?;
                }
            }
        }
        let answer = |worker| (worker, answers.remove(&worker).expect("every order is answered"));
        Ok(sequence.into_iter().map(answer).collect())
    }

    fn take_in(
        &mut self,
        Event { worker, generation, what }: Event,
        open: &mut BTreeMap<usize, Task>,
        answers: &mut BTreeMap<usize, Answer>,
    ) -> Result<()> {
        // Late news of a process that was given up change nothing.
        if generation != self.workers[worker].generation {
            return Ok(());
        }
        match what {
            What::Said(report) => {
                if let Some(answer) = self.hear(worker, report, open, answers.len())? {
                    open.remove(&worker);
                    answers.insert(worker, answer);
                }
                Ok(())
            }
            What::Gone(reason) => self.lose(worker, Loss::Gone(reason), open.get_mut(&worker)),
        }
    }

    /// Takes in what a worker says; its answer where that is one.
    fn hear(
        &mut self,
        worker: usize,
        report: Report,
        open: &mut BTreeMap<usize, Task>,
        done: usize,
    ) -> Result<Option<Answer>> {
        if let Some(task) = open.get_mut(&worker) {
            task.silence = Duration::ZERO;
        }
        match report {
            Report::Failed { reason } => bail!("{}: {reason}", self.name(worker)),
            Report::Done { answer, load } => {
                let mine = &mut self.workers[worker].load;
                mine.timesheet.add(&load.timesheet);
                mine.footprint = mine.footprint.max(load.footprint);
                // A worker that has begun or was restored says so before it turns to its order.
                Ok(Some(*answer).filter(|answer| !matches!(answer, Answer::Ready)))
            }
            progress => {
                if let Some(task) = open.get_mut(&worker) {
                    task.progress = Some(progress);
                    self.tell_progress(open, done);
                }
                Ok(None)
            }
        }
    }

    /// Sends a task to its worker, whose process is started first where there is none. Does not wait for the worker.
    fn deliver(&mut self, worker: usize, task: &mut Task) -> Result<()> {
        if self.workers[worker].child.is_none() {
            self.spawn(worker)?;
        }
        task.silence = Duration::ZERO;
        let child = self.workers[worker].child.as_ref().expect("it was just started");
        task.frames.send(child);
        Ok(())
    }

    /// Starts the process of a worker and puts it where the last exchange left its agents.
    fn spawn(&mut self, worker: usize) -> Result<()> {
        let log = self.options.log_dir.join(format!("worker_{worker}.log"));
        let slot = &mut self.workers[worker];
        slot.generation += 1;
        let child = Child::spawn(worker, slot.generation, &log, self.sender.clone())?;
        let agents = slot.agents.clone();
        let begin = Order::Begin {
            config_json: serde_json::to_string(&self.config)?,
            agents: agents.clone().map(AgentId).collect(),
            threads: if self.config.simulator == SimulatorKind::Gs { self.options.workers } else { 1 },
        };
        child.send(encode(&begin)?.into());
        if self.agents.agents() > 0 && !agents.is_empty() {
            child.send(encode(&Order::Restore(self.agents.share(agents)))?.into());
        }
        slot.child = Some(child);
        Ok(())
    }

    /// A worker's process has gone, or must go. With a task it is started again and given it again.
    fn lose(&mut self, worker: usize, loss: Loss, task: Option<&mut Task>) -> Result<()> {
        let Some(child) = self.workers[worker].child.take() else { return Ok(()) };
        let message = format!("{} {}", self.name(worker), loss.describe(child, self.options.patience));
        let Some(task) = task else {
            // It has nothing to do: the next order will start it again.
            self.observer.worker_lost(&message);
            return Ok(());
        };
        task.deaths += 1;
        if task.deaths == DEATHS_IN_A_ROW {
            bail!("{message}\ngiven up after {DEATHS_IN_A_ROW} deaths in a row at the same place");
        }
        self.observer.worker_lost(&format!("{message}\nstarted again from the last exchange"));
        self.deliver(worker, task)
    }

    fn name(&self, worker: usize) -> String {
        let agents = &self.workers[worker].agents;
        match agents.len() {
            0 => format!("worker {worker} (no agents of its own)"),
            1 => format!("worker {worker} (agent {})", agents.start),
            _ => format!("worker {worker} (agents {}..{})", agents.start, agents.end - 1),
        }
    }

    /// The slowest worker counts for training, the mean for everything else.
    fn tell_progress(&self, open: &BTreeMap<usize, Task>, done: usize) {
        let reports = || open.values().filter_map(|task| task.progress.as_ref());
        let slowest = reports().filter_map(|report| match report {
            Report::Trained { steps } => Some(*steps),
            _ => None,
        });
        if let Some(steps) = slowest.min() {
            self.observer.trained(steps);
        }
        let shares: Vec<(Activity, f64)> = reports()
            .filter_map(|report| match report {
                Report::Busy { activity, share } => Some((*activity, *share)),
                _ => None,
            })
            .collect();
        if let Some(&(activity, _)) = shares.first() {
            let sum = shares.iter().map(|(_, share)| share).sum::<f64>() + done as f64;
            self.observer.busy(activity, sum / (open.len() + done) as f64);
        }
    }
}

/// An encoded order, to be sent any number of times.
#[derive(Clone)]
struct Frames {
    /// What the worker needs first.
    before: Option<Frame>,
    order: Frame,
}

impl Frames {
    fn of(order: &Order) -> Result<Frames> {
        Ok(Frames { before: None, order: encode(order)?.into() })
    }

    fn send(&self, child: &Child) {
        self.before.iter().chain([&self.order]).for_each(|frame| child.send(frame.clone()));
    }
}

/// An order under way.
struct Task {
    frames: Frames,
    deaths: usize,
    /// Time since the worker was given the order or was heard, as far as the coordinator was listening.
    silence: Duration,
    progress: Option<Report>,
}

/// Why a worker is given up.
enum Loss {
    /// Its channel is closed, or carries nonsense for this reason.
    Gone(Option<anyhow::Error>),
    /// It said nothing for longer than the patience.
    Silent,
}

impl Loss {
    /// Ends the child and returns what became of it.
    fn describe(self, child: Child, patience: Duration) -> String {
        match self {
            Loss::Gone(Some(reason)) => format!("died: {reason:#}; {}", child.end()),
            Loss::Gone(None) => format!("died: {}", child.end()),
            Loss::Silent => {
                let state = child.state().unwrap_or_else(|| "unknown".to_owned());
                let end = child.end_by_force();
                format!("said nothing for {patience:?} (state: {state}) and was ended; {end}")
            }
        }
    }
}

/// When a request to stop is heard.
#[derive(Clone, Copy, PartialEq)]
enum Stop {
    /// Nothing is lost by stopping right away.
    AtOnce,
    /// A period's work would be lost.
    Later,
}

impl Fleet for ProcessFleet {
    fn agents(&self) -> &AgentsState {
        &self.agents
    }

    fn restore(&mut self, agents: AgentsState) -> Result<()> {
        self.agents = agents;
        for worker in self.owners() {
            // The next order starts it again, in this state.
            self.workers[worker].child = None;
        }
        Ok(())
    }

    fn evaluate(&mut self, episodes: usize) -> Result<Evaluation> {
        self.observer.busy(Activity::Evaluation, 0.0);
        let orders = self.by_episode(episodes, |episodes| Order::Evaluate { episodes })?;
        let mut reports = Vec::new();
        self.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::Evaluated(part) => reports.extend(part),
            other => unreachable!("episodes were asked for, not {other:?}"),
        })?;
        Ok(Evaluation::new(&*self.domain, &reports))
    }

    fn collect_datasets(&mut self, purpose: Purpose) -> Result<Vec<Dataset>> {
        self.observer.busy(purpose.activity(&self.config), 0.0);
        let horizon = self.domain.kinds().horizon();
        let order = |episodes| Order::Collect { purpose, episodes };
        let orders = self.by_episode(purpose.episodes(&self.config, horizon), order)?;
        let mut datasets = Dataset::of_all(self.domain.kinds());
        self.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::Collected(parts) => {
                datasets.iter_mut().zip(&parts).for_each(|(dataset, part)| dataset.extend(part));
            }
            other => unreachable!("datasets were asked for, not {other:?}"),
        })?;
        Ok(datasets)
    }

    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<Vec<AipLoss>> {
        self.observer.busy(Activity::AipTraining, 0.0);
        let orders = self.by_owner(datasets, |datasets| Order::TrainAips { datasets, period: *period })?;
        let mut all = Vec::new();
        self.ask(orders, Stop::AtOnce, |state, agents, answer| match answer {
            Answer::AipsTrained { losses, aips } => {
                all.extend(losses);
                state.aips.replace(agents.start, &aips);
            }
            other => unreachable!("AIPs were asked for, not {other:?}"),
        })?;
        Ok(all)
    }

    fn measure_aips(&mut self, datasets: Vec<Dataset>) -> Result<Vec<FreshLoss>> {
        self.observer.busy(Activity::Evaluation, 0.0);
        let orders = self.by_owner(datasets, |datasets| Order::MeasureAips { datasets })?;
        let mut all = Vec::new();
        self.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::AipsMeasured(losses) => all.extend(losses),
            other => unreachable!("losses were asked for, not {other:?}"),
        })?;
        Ok(all)
    }

    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining> {
        self.observer.trained(self.agents.steps);
        let order = Frames::of(&Order::TrainPolicies { period: *period })?;
        let orders = self.owners().map(|worker| (worker, order.clone())).collect();
        let mut parts = Vec::new();
        self.ask(orders, Stop::Later, |whole, agents, answer| match answer {
            Answer::PoliciesTrained { training, state } => {
                parts.push(training);
                whole.replace(agents.start, &state);
            }
            other => unreachable!("policies were asked for, not {other:?}"),
        })?;
        Ok(PolicyTraining::joined(parts))
    }

    fn take_load(&mut self) -> FleetLoad {
        let workers = self
            .workers
            .iter_mut()
            .map(|slot| WorkerLoad { timesheet: slot.load.timesheet.take(), footprint: slot.load.footprint });
        FleetLoad {
            workers: workers.collect(),
            at_work: std::mem::take(&mut self.at_work),
            coordinator: Some(Footprint::of_this_process()),
            coordinator_cpu: self.clock.lap(),
        }
    }
}

/// The `index`-th of `parts` nearly equal shares of `0..total`, one after another.
fn share(total: usize, parts: usize, index: usize) -> Range<usize> {
    total * index / parts..total * (index + 1) / parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_follow_each_other_and_are_nearly_equal() {
        let shares: Vec<_> = (0..3).map(|index| share(10, 3, index)).collect();
        assert_eq!(shares, [0..3, 3..6, 6..10]);
        assert_eq!((0..4).map(|index| share(2, 4, index).len()).collect::<Vec<_>>(), [0, 1, 0, 1]);
    }
}
