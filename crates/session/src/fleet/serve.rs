//! The worker's side of the channel, whatever carries it.

use std::cell::{Cell, RefCell};
use std::io::{Read, Write};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use super::apart::{self, Apart, SimulatorLost};
use super::channel::{receive, send};
use super::message::{Order, WorkerReport};
use super::process::{CpuClock, footprint, resident_kib};
use crate::config::RunConfig;
use crate::python::{learner, predictor};
use dials_core::base::Activity;
use dials_core::domain::Domain;
use dials_learn::fleet::WorkerLoad;
use dials_learn::observer::Observer;
use dials_learn::steps::Reply;
use dials_learn::worker::Worker;
use stacknets::Threads;

/// Shortest time between two progress reports.
const REPORT_EVERY: Duration = Duration::from_millis(100);

/// Does what the coordinator at the other end of `stream` orders, until the stream ends.
pub fn serve(stream: impl Read + Write, open_domain: impl FnOnce(&RunConfig) -> Result<Arc<dyn Domain>>) -> Result<()> {
    let reporter = Reporter { stream: RefCell::new(stream), last: Cell::new(Instant::now()) };
    let Some(order) = reporter.next_order().context("this command is for the program itself, not for people")? else {
        return Ok(());
    };
    if let Order::Begin { agents, .. } = &order {
        let owned = match agents.first().zip(agents.last()) {
            Some((first, last)) => format!("owns agents {first} to {last}"),
            None => "owns no agents and plays episodes".to_owned(),
        };
        // A line for the log. If it cannot be written, the work continues.
        let _ = writeln!(std::io::stderr(), "process {} {owned}", std::process::id());
    }
    let mut server = Server::begin(order, CpuClock::of_the_process(), open_domain)?;
    reporter.send(&WorkerReport::Begun)?;
    while let Some(order) = reporter.next_order()? {
        if let Some(report) = server.carry_out(order, &reporter)? {
            reporter.send(&report)?;
        }
    }
    Ok(())
}

pub(super) struct Server {
    worker: Worker,
    clock: CpuClock,
}

impl Server {
    /// Carries out the first order. `clock`: the CPU time that counts as the worker's.
    pub(super) fn begin(
        order: Order,
        clock: CpuClock,
        open_domain: impl FnOnce(&RunConfig) -> Result<Arc<dyn Domain>>,
    ) -> Result<Server> {
        let Order::Begin { config_json, agents, threads, prepared } = order else {
            bail!("the first order must be to begin")
        };
        let config: RunConfig = serde_json::from_str(&config_json)?;
        let domain = open_domain(&config)?;
        prepared.as_ref().map_or(Ok(()), |prepared| domain.take_prepared(prepared))?;
        learner::connect(&config, &*domain)?;
        predictor::install(&config, &*domain);
        let worker = Worker::new(domain, &config.learning, agents, &Threads::new(threads)?);
        let worker = worker.with_makers(Box::new(Apart { config_json, prepared, at_once: threads }));
        Ok(Server { worker, clock })
    }

    /// Carries out an order. Returns the report that ends a step. An error: the order cannot be understood.
    pub(super) fn carry_out(&mut self, order: Order, observer: &dyn Observer) -> Result<Option<WorkerReport>> {
        match order {
            Order::Begin { .. } => bail!("this worker has already begun"),
            Order::Restore(state) => self.worker.restore(&state),
            Order::TakePolicies(joint) => self.worker.take_policies(joint),
            Order::Step(request) => {
                return Ok(Some(match request.run(&mut self.worker, observer) {
                    Ok(reply) => self.done(reply),
                    // Another worker can.
                    Err(error) if error.is::<SimulatorLost>() => return Err(error),
                    Err(error) => WorkerReport::Failed { reason: format!("{error:#}") },
                }));
            }
        }
        Ok(None)
    }

    fn done(&mut self, reply: Reply) -> WorkerReport {
        let mut timesheet = self.worker.take_timesheet();
        timesheet.note_cpu(self.clock.lap() + apart::take_cpu());
        let load = WorkerLoad { timesheet, footprint: footprint().and(apart::take_footprint()) };
        WorkerReport::Done { reply: Box::new(reply), load: Box::new(load), resident_kib: resident_kib() }
    }
}

struct Reporter<S> {
    stream: RefCell<S>,
    last: Cell<Instant>,
}

impl<S: Read + Write> Reporter<S> {
    fn next_order(&self) -> Result<Option<Order>> {
        receive(&mut *self.stream.borrow_mut())
    }

    fn send(&self, report: &WorkerReport) -> Result<()> {
        send(&mut *self.stream.borrow_mut(), report)
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
