//! The coordinator's view of its workers, whatever they are: child processes, processes on other machines, this process.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::Result;

use super::message::WorkerReport;

/// An encoded message with its header, shared by all receivers.
pub(crate) type Frame = Arc<Vec<u8>>;

/// News from a link. `T`: what a worker says, decoded or not.
pub enum News<T = WorkerReport> {
    Said(T),
    /// The stream has ended, or carries invalid data for this reason.
    Gone(Option<anyhow::Error>),
}

/// The coordinator's end of the two-way stream between it and one worker. Dropping it ends the worker.
/// Nothing that a worker does or fails to do may block a link.
pub trait Link<T = WorkerReport> {
    /// Sends a frame, after the earlier ones, without waiting. If the worker has gone, [`News::Gone`] reports it.
    fn send(&self, frame: Frame);

    /// Returns the worker's next message; if there is none yet: `None`. Does not wait.
    fn next(&mut self) -> Option<News<T>>;

    /// Returns what a silent worker is doing, if the system knows it.
    fn state(&self) -> Option<String>;

    /// Ends a worker whose stream has ended. Returns how it ended and where to read more.
    fn end(self: Box<Self>) -> String;

    /// Ends a worker that hangs. Returns where to read more.
    fn end_by_force(self: Box<Self>) -> String;
}

/// The workers of a coordinator, numbered from 0.
pub trait Crew {
    /// Starts a worker that waits for its first order, or another one for a lost one: see [`Crew::can_replace`].
    fn start(&mut self, worker: usize) -> Result<Box<dyn Link>>;

    /// Returns whether a worker that was lost can be started again. If not, its loss is the end of the run.
    fn can_replace(&self) -> bool;

    /// Returns whether the only worker is this process itself.
    fn is_this_process(&self) -> bool {
        false
    }

    /// Waits until a link has news, which unparks the thread that started it, but not longer than `at_most`.
    fn wait(&mut self, at_most: Duration) {
        thread::park_timeout(at_most);
    }
}

pub(super) enum Loss {
    /// The stream has ended, or carries invalid data for this reason.
    Gone(Option<anyhow::Error>),
    /// The worker said what cannot be right, for this reason.
    Nonsense(anyhow::Error),
    /// The worker said nothing for longer than the patience.
    Silent,
}

impl Loss {
    /// Ends the worker and returns what happened to it.
    pub(super) fn describe(self, link: Box<dyn Link>, patience: Duration) -> String {
        match self {
            Loss::Gone(Some(reason)) => format!("died: {reason:#}; {}", link.end()),
            Loss::Gone(None) => format!("died: {}", link.end()),
            Loss::Nonsense(reason) => {
                format!("sent what cannot be right ({reason:#}) and was ended; {}", link.end_by_force())
            }
            Loss::Silent => {
                let state = link.state().unwrap_or_else(|| "unknown".to_owned());
                let end = link.end_by_force();
                format!(
                    "said nothing for {patience:?} (state: {state}) and was ended; if it needs more time, --patience gives \
                     it; {end}"
                )
            }
        }
    }
}
