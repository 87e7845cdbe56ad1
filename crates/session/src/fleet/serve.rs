//! The worker's side of the channel, whatever carries it.

use std::cell::{Cell, RefCell};
use std::io::{Read, Write};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use super::channel::{receive, send};
use super::footprint::{CpuClock, footprint, resident_kib};
use super::message::{Answer, Order, WorkerReport};
use super::worker::Worker;
use crate::config::RunConfig;
use dials_core::base::Activity;
use dials_core::domain::Domain;
use dials_learn::policy::JointPolicy;
use dials_learn::training::answers::WorkerLoad;
use dials_learn::training::observer::Observer;
use stacknets::Threads;

/// Shortest time between two progress reports.
const REPORT_EVERY: Duration = Duration::from_millis(100);

/// Does what the coordinator at the other end of `stream` orders, until the stream ends.
///
/// `open_domain` makes the domain of a config, because this room does not know which domains there are.
pub fn serve(stream: impl Read + Write, open_domain: impl FnOnce(&RunConfig) -> Result<Arc<dyn Domain>>) -> Result<()> {
    let reporter = Reporter {
        stream: RefCell::new(stream),
        last: Cell::new(Instant::now()),
        clock: RefCell::new(CpuClock::of_the_process()),
    };
    let Some(order) = reporter.next_order().context("this command is for the program itself, not for people")? else {
        return Ok(());
    };
    let Order::Begin { config_json, agents, threads, prepared } = order else {
        bail!("the first order must be to begin")
    };
    let config: RunConfig = serde_json::from_str(&config_json)?;
    // A line for the log. If it cannot be written, the work continues.
    let owned = match agents.first().zip(agents.last()) {
        Some((first, last)) => format!("owns agents {first} to {last}"),
        None => "owns no agents and plays episodes".to_owned(),
    };
    let _ = writeln!(std::io::stderr(), "process {} {owned}", std::process::id());
    let domain = open_domain(&config)?;
    prepared.map_or(Ok(()), |prepared| domain.take_prepared(&prepared))?;
    let mut worker = Worker::new(domain, &config.learning, agents, &Threads::new(threads)?);
    reporter.done(Answer::Ready, &mut worker)?;
    let mut policies = None;
    while let Some(order) = reporter.next_order()? {
        match carry_out(order, &mut worker, &mut policies, &reporter) {
            Ok(answer) => reporter.done(answer, &mut worker)?,
            Err(error) => reporter.send(&WorkerReport::Failed { reason: format!("{error:#}") })?,
        }
    }
    Ok(())
}

fn carry_out(
    order: Order,
    worker: &mut Worker,
    policies: &mut Option<JointPolicy>,
    reporter: &Reporter<impl Read + Write>,
) -> Result<Answer> {
    let mut take_policies = || policies.take().context("no policies were sent before this order");
    Ok(match order {
        Order::Begin { .. } => bail!("this worker has already begun"),
        Order::Restore(state) => {
            worker.restore(&state);
            Answer::Ready
        }
        Order::TakePolicies(joint) => {
            *policies = Some(joint);
            Answer::Ready
        }
        Order::TellState => Answer::State(worker.state()),
        Order::Demonstrate { controller, episodes } => {
            Answer::Demonstrated(worker.demonstrate(&controller, episodes, reporter)?)
        }
        Order::Imitate { demonstrations } => {
            let losses = worker.imitate(demonstrations, reporter);
            Answer::Imitated { losses, policies: worker.policies() }
        }
        Order::Collect { purpose, episodes } => {
            Answer::Collected(worker.collect(&take_policies()?, purpose, episodes, reporter)?)
        }
        Order::TrainAips { datasets, period } => {
            let losses = worker.train_aips(datasets, &period, reporter);
            Answer::AipsTrained { losses, aips: worker.aips() }
        }
        Order::MeasureAips { datasets } => Answer::AipsMeasured(worker.measure_aips(datasets)),
        Order::TrainPolicies { period } => {
            let training = worker.train_policies(&period, reporter)?;
            Answer::PoliciesTrained { training, state: worker.state() }
        }
        Order::Evaluate { episodes } => Answer::Evaluated(worker.evaluate(&take_policies()?, episodes, reporter)?),
    })
}

/// The worker's connection to the coordinator.
struct Reporter<S> {
    stream: RefCell<S>,
    last: Cell<Instant>,
    clock: RefCell<CpuClock>,
}

impl<S: Read + Write> Reporter<S> {
    fn next_order(&self) -> Result<Option<Order>> {
        receive(&mut *self.stream.borrow_mut())
    }

    fn send(&self, report: &WorkerReport) -> Result<()> {
        send(&mut *self.stream.borrow_mut(), report)
    }

    fn done(&self, answer: Answer, worker: &mut Worker) -> Result<()> {
        let mut timesheet = worker.take_timesheet();
        timesheet.note_cpu(self.clock.borrow_mut().lap());
        let load = WorkerLoad { timesheet, footprint: footprint() };
        let (answer, load) = (Box::new(answer), Box::new(load));
        self.send(&WorkerReport::Done { answer, load, resident_kib: resident_kib() })
    }

    fn progress(&self, report: &WorkerReport) {
        let now = Instant::now();
        if now - self.last.get() >= REPORT_EVERY {
            self.last.set(now);
            // If the coordinator has gone, the next order shows it; until then nobody reads.
            drop(self.send(report));
        }
    }
}

impl<S: Read + Write> Observer for Reporter<S> {
    fn trained(&self, steps: u64) {
        self.progress(&WorkerReport::Trained { steps });
    }

    fn busy(&self, activity: Activity, share: f64) {
        self.progress(&WorkerReport::Busy { activity, share });
    }
}
