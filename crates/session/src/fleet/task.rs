//! A step in progress: what a worker was sent, and what it has reported since then.

use std::time::Duration;

use anyhow::Result;

use super::channel::encode;
use super::link::{Frame, Link};
use super::message::{Order, WorkerReport};
use dials_core::base::Activity;
use dials_learn::observer::Observer;
use dials_learn::steps::{Check, Step};

/// A step that a worker has not answered yet.
pub(super) struct Task<Reply> {
    /// Message that the worker needs first.
    before: Option<Frame>,
    step: Frame,
    /// Up to which timestep per agent it trains, if it does.
    pub(crate) trains_until: Option<u64>,
    pub(crate) check: Check<Reply>,
    /// Number of times that a worker was lost at it.
    pub(crate) deaths: usize,
    /// Time since the worker got the step or last reported, as far as the coordinator was listening.
    pub(crate) silence: Duration,
    pub(crate) progress: Option<WorkerReport>,
}

impl<Reply> Task<Reply> {
    /// Encodes a step once, so that it can be sent any number of times.
    pub(super) fn of<S: Step<Reply = Reply>>(step: S, before: Option<Frame>) -> Result<Task<Reply>> {
        Ok(Task {
            before,
            check: step.check(),
            trains_until: step.trains_until(),
            step: encode(&Order::Step(step.request()))?.into(),
            deaths: 0,
            silence: Duration::ZERO,
            progress: None,
        })
    }

    pub(super) fn send(&self, link: &dyn Link) {
        self.before.iter().chain([&self.step]).for_each(|frame| link.send(frame.clone()));
    }
}

/// Reports the progress of an order: of the slowest worker in training, else the mean. `done`: number of finished ones.
pub(super) fn report_progress<'a, Reply: 'a>(
    open: impl Iterator<Item = &'a Task<Reply>> + Clone,
    done: usize,
    observer: &dyn Observer,
) {
    let reports = || open.clone().filter_map(|task| task.progress.as_ref());
    let slowest = reports().filter_map(|report| match report {
        WorkerReport::Trained { steps } => Some(*steps),
        _ => None,
    });
    if let Some(steps) = slowest.min() {
        observer.trained(steps);
    }
    let shares: Vec<(Activity, f64)> = reports()
        .filter_map(|report| match report {
            WorkerReport::Busy { activity, share } => Some((*activity, *share)),
            _ => None,
        })
        .collect();
    if let Some(&(activity, _)) = shares.first() {
        let sum = shares.iter().map(|(_, share)| share).sum::<f64>() + done as f64;
        observer.busy(activity, sum / (open.count() + done) as f64);
    }
}
