//! Workers that are child processes of this program: how they start, their channel, how they end.
//!
//! Two threads work between the coordinator and its child: one writes what is to be sent, one reads what the child
//! sends. So nothing that a child does or fails to do can block the coordinator.

use std::fs;
use std::io::Write;
use std::net::Shutdown;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{self, Thread};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use rustix::process::{Signal, set_parent_process_death_signal};

use super::channel::receive;
use super::link::{Crew, Frame, Link, News};
use super::log::Log;
use super::message::WorkerReport;
use super::serve::serve;
use crate::config::RunConfig;
use crate::machine::why_aborted;
use dials_core::domain::Domain;
use dials_core::outside::Directory;

/// Number of files that the coordinator has open for each worker: its channel and its log.
pub const FILES_PER_WORKER: u64 = 2;
/// The hidden subcommand that makes this program a worker.
const WORKER: &str = "worker";
/// Time in which a child whose channel is closed may end by itself.
const LAST_WORDS: Duration = Duration::from_millis(200);
/// Time in which a killed child must end. One that hangs inside the kernel (a dead network disk) is left alone.
const DYING: Duration = Duration::from_secs(2);

/// Does what the coordinator that started this process orders through standard input, until that is closed.
pub fn serve_the_parent(open_domain: impl FnOnce(&RunConfig) -> Result<Arc<dyn Domain>>) -> Result<()> {
    // However the coordinator ends, this process must end with it, because nothing else would end it.
    set_parent_process_death_signal(Some(Signal::KILL)).context("cannot make this worker end with its coordinator")?;
    let stdin = std::io::stdin().as_fd().try_clone_to_owned().context("no standard input")?;
    serve(UnixStream::from(stdin), open_domain)
}

/// Child processes, each with its own log. A lost one can be replaced by another.
/// `.0`: folder of the logs, `worker_N.log`.
pub struct Children(pub Directory);

impl Crew for Children {
    fn start(&mut self, worker: usize) -> Result<Box<dyn Link>> {
        let log = Log::open(&self.0, log_of(worker))?;
        Ok(Box::new(ChildProcess::spawn(worker, log, None, |stream| receive(stream))?))
    }

    fn can_replace(&self) -> bool {
        true
    }
}

pub(super) fn log_of(worker: usize) -> String {
    format!("worker_{worker}.log")
}

type Hear<T> = fn(&mut &UnixStream) -> Result<Option<T>>;

/// A running worker process. Dropping it kills it. `T`: what it says, decoded or not.
pub(crate) struct ChildProcess<T = WorkerReport> {
    process: std::process::Child,
    stream: Arc<UnixStream>,
    /// Frames that the writer thread has not taken yet.
    outbox: Sender<Frame>,
    inbox: Receiver<News<T>>,
    log: Log,
}

impl<T: Send + 'static> ChildProcess<T> {
    /// Starts this program as a worker, in the folder `paths_from` or this one. Its messages wake the calling thread.
    pub(super) fn spawn(worker: usize, log: Log, paths_from: Option<&Path>, hear: Hear<T>) -> Result<ChildProcess<T>> {
        let (stream, theirs) = UnixStream::pair().context("no socket for a worker")?;
        // Not by its path, where another build may be. Not from another thread, with whose end the worker is killed.
        let mut command = Command::new("/proc/self/exe");
        if let Some(folder) = paths_from {
            command.current_dir(folder);
        }
        let process = command
            .arg(WORKER)
            // Another one may have been installed since this process began.
            .envs(dials_traffic::sumo_for_children())
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(log.file()?)
            .stderr(log.file()?)
            // Ctrl-C at the terminal is for the coordinator, which ends its workers when it is ready.
            .process_group(0)
            .spawn()
            .context("cannot start a worker")?;
        let (outbox, frames) = channel();
        let (news, inbox) = channel();
        // From here on, dropping it kills the process.
        let child = ChildProcess { process, stream: Arc::new(stream), outbox, inbox, log };
        let (reader, writer) = (child.stream.clone(), child.stream.clone());
        let coordinator = thread::current();
        let read = move || read_all(&reader, hear, &news, &coordinator);
        let name = format!("worker {worker} reader");
        thread::Builder::new().name(name).spawn(read).context("cannot start the thread that reads from a worker")?;
        let write = move || write_all(&writer, &frames);
        let name = format!("worker {worker} writer");
        thread::Builder::new().name(name).spawn(write).context("cannot start the thread that writes to a worker")?;
        Ok(child)
    }
}

impl<T> ChildProcess<T> {
    fn kill(&mut self) -> Option<ExitStatus> {
        drop(self.process.kill());
        // Ends both threads, even if the process does not end.
        drop(self.stream.shutdown(Shutdown::Both));
        self.ended_within(DYING)
    }

    fn ended_within(&mut self, time: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        loop {
            match self.process.try_wait() {
                Ok(Some(status)) => return Some(status),
                Ok(None) if begun.elapsed() < time => thread::sleep(Duration::from_millis(2)),
                Ok(None) | Err(_) => return None,
            }
        }
    }
}

impl<T> Link<T> for ChildProcess<T> {
    fn send(&self, frame: Frame) {
        // Its writer ends early only when the child has gone.
        let _ = self.outbox.send(frame);
    }

    fn next(&mut self) -> Option<News<T>> {
        self.inbox.try_recv().ok()
    }

    /// Returns the state of the process as Linux names it, such as `S (sleeping)` or `T (stopped)`.
    fn state(&self) -> Option<String> {
        let status = fs::read_to_string(format!("/proc/{}/status", self.process.id())).ok()?;
        Some(status.lines().find_map(|line| line.strip_prefix("State:"))?.trim().to_owned())
    }

    /// Kills a child that does not end. Returns how it ended and the last lines of its log.
    fn end(mut self: Box<Self>) -> String {
        let status = self.ended_within(LAST_WORDS).or_else(|| self.kill());
        let tail = self.log.tail();
        format!("{}; {tail}", describe(status, &tail))
    }

    fn end_by_force(mut self: Box<Self>) -> String {
        match self.kill() {
            Some(_) => self.log.tail(),
            None => format!("process {} does not end; {}", self.process.id(), self.log.tail()),
        }
    }
}

impl<T> Drop for ChildProcess<T> {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Passes on what a child sends to the coordinator, and wakes it, until the child or its [`ChildProcess`] has gone.
fn read_all<T>(mut stream: &UnixStream, hear: Hear<T>, news: &Sender<News<T>>, coordinator: &Thread) {
    loop {
        let heard = match hear(&mut stream) {
            Ok(Some(report)) => News::Said(report),
            Ok(None) => News::Gone(None),
            Err(error) => News::Gone(Some(error)),
        };
        let last = matches!(heard, News::Gone(_)) | news.send(heard).is_err();
        coordinator.unpark();
        if last {
            break;
        }
    }
}

/// Writes the frames to a child until the child or its [`ChildProcess`] has gone.
fn write_all(mut stream: &UnixStream, frames: &Receiver<Frame>) {
    for frame in frames {
        if stream.write_all(&frame).is_err() {
            // Makes the reader notice, whatever the reason.
            drop(stream.shutdown(Shutdown::Both));
            break;
        }
    }
}

/// Returns how a worker ended; `log`: its last lines, which show why it aborted.
fn describe(status: Option<ExitStatus>, log: &str) -> String {
    match status.map(|status| (status.code(), status.signal())) {
        Some((Some(code), _)) => format!("exit code {code}"),
        Some((_, Some(9))) => "signal 9 (killed; out of memory?)".to_owned(),
        Some((_, Some(6))) => format!("signal 6 ({})", why_aborted(log)),
        Some((_, Some(signal))) => format!("signal {signal}"),
        _ => "in an unknown way".to_owned(),
    }
}
