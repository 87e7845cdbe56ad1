//! What a coordinator knows of its workers, whatever they are: child processes, processes on other machines, threads.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;

use super::message::Report;

/// An encoded message, with its header. Shared by all who are sent it.
pub type Frame = Arc<Vec<u8>>;

/// What a link has heard.
pub enum News {
    Said(Report),
    /// The stream has ended, or carries nonsense for this reason.
    Gone(Option<anyhow::Error>),
}

/// The coordinator's end of the two-way stream between it and one worker. Dropping it ends the worker.
///
/// Nothing that a worker does or fails to do may block a link.
pub trait Link {
    /// Sends a frame, after those before it. Does not wait until the worker reads it.
    ///
    /// If the worker has gone, [`News::Gone`] says so.
    fn send(&self, frame: Frame);

    /// Returns what the worker said next; `None`: nothing yet. Does not wait.
    fn next(&mut self) -> Option<News>;

    /// Returns what a worker is doing that says nothing, if the system knows it.
    fn state(&self) -> Option<String>;

    /// Ends a worker whose stream has ended. Returns how it ended and where to read on.
    fn end(self) -> String;

    /// Ends a worker that hangs. Returns where to read on.
    fn end_by_force(self) -> String;
}

/// The workers of a coordinator, numbered from 0.
pub trait Crew {
    type Link: Link;

    /// Starts a worker that waits for its first order. A worker that was lost is started again where
    /// [`Crew::can_replace`] allows it.
    fn start(&mut self, worker: usize) -> Result<Self::Link>;

    /// Whether a worker that was lost can be started again. If not, its loss is the end of the run.
    fn can_replace(&self) -> bool;

    /// Waits until a link has news, but not longer than `at_most`.
    fn wait(&mut self, at_most: Duration);
}
