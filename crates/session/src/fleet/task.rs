//! An order in progress: what a worker was sent, and what it has reported since then.

use std::time::Duration;

use anyhow::Result;

use super::channel::encode;
use super::expected::Expected;
use super::link::{Frame, Link};
use super::message::{Order, WorkerReport};
use dials_core::base::Activity;
use dials_learn::training::observer::Observer;

/// An encoded order that can be sent any number of times.
#[derive(Clone)]
pub struct Frames {
    /// Message that the worker needs first.
    before: Option<Frame>,
    order: Frame,
    /// Answer that the order must get.
    pub expected: Expected,
}

impl Frames {
    pub fn of(order: &Order) -> Result<Frames> {
        Ok(Frames { before: None, order: encode(order)?.into(), expected: Expected::of(order) })
    }

    /// Makes an order with a frame that is sent before it.
    pub fn after(before: Frame, order: &Order) -> Result<Frames> {
        Ok(Frames { before: Some(before), ..Frames::of(order)? })
    }

    pub fn send(&self, link: &impl Link) {
        self.before.iter().chain([&self.order]).for_each(|frame| link.send(frame.clone()));
    }
}

/// An order that a worker has not answered yet.
pub struct Task {
    pub frames: Frames,
    /// Number of times that a worker was lost at it.
    pub deaths: usize,
    /// Time since the worker got the order or last reported, as far as the coordinator was listening.
    pub silence: Duration,
    pub progress: Option<WorkerReport>,
}

impl Task {
    pub fn new(frames: Frames) -> Task {
        Task { frames, deaths: 0, silence: Duration::ZERO, progress: None }
    }
}

/// Reports the progress of the workers that have the same order; `done`: how many have finished it.
///
/// In training, the slowest worker counts; in all other activities, the mean.
pub fn tell_progress<'a>(open: impl Iterator<Item = &'a Task> + Clone, done: usize, observer: &dyn Observer) {
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
