//! One child process: its birth, its channel, its end.
//!
//! Two threads stand between the coordinator and its child: one writes what is to be sent, one reads what the child
//! says. So nothing that a child does or fails to do can block the coordinator.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::net::Shutdown;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use super::channel::receive;
use super::log_tail::log_tail;
use super::message::Report;

/// The hidden subcommand that makes this program a worker.
const WORKER: &str = "worker";
/// Time in which a child whose channel is closed may end by itself.
const LAST_WORDS: Duration = Duration::from_millis(200);
/// Time in which a killed child ends. One that hangs inside the kernel, as on a dead network disk, is left to it.
const DYING: Duration = Duration::from_secs(2);

/// An encoded message, with its header. Shared by all who are sent it.
pub type Frame = Arc<Vec<u8>>;

/// Something that a child said, or that it has gone.
pub struct Event {
    pub worker: usize,
    /// Which of the processes that have had this number: news of a lost one come late.
    pub generation: u64,
    pub what: What,
}

pub enum What {
    Said(Report),
    /// The channel is closed, or carries nonsense for this reason.
    Gone(Option<anyhow::Error>),
}

/// A running worker process. Dropping it kills it.
pub struct Child {
    process: std::process::Child,
    stream: Arc<UnixStream>,
    /// Frames that the writer thread has not taken yet.
    outbox: Sender<Frame>,
    log: PathBuf,
}

impl Child {
    /// Starts this program as a worker; what it says goes to `events`, what it prints to `log`.
    pub fn spawn(worker: usize, generation: u64, log: &Path, events: Sender<Event>) -> Result<Child> {
        let (stream, theirs) = UnixStream::pair().context("no socket for a worker")?;
        let opened = OpenOptions::new().create(true).append(true).open(log);
        let log_file = opened.with_context(|| format!("{}: cannot be written", log.display()))?;
        // Not the path of the program, where another build may stand by now. Not from another thread: the worker asks
        // the system to be killed when the thread that started it ends.
        let process = Command::new("/proc/self/exe")
            .arg(WORKER)
            // Or BLAS, which came with libtorch, would keep a thread per core in every worker, for nothing.
            .env("OPENBLAS_NUM_THREADS", "1")
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(log_file.try_clone()?)
            .stderr(log_file)
            // Ctrl-C at the terminal is for the coordinator, which ends its workers in its own time.
            .process_group(0)
            .spawn()
            .context("a worker cannot be started")?;
        let (outbox, frames) = channel();
        // From here on dropping it kills the process.
        let child = Child { process, stream: Arc::new(stream), outbox, log: log.to_owned() };
        let (reader, writer) = (child.stream.clone(), child.stream.clone());
        let name = |thread: &str| format!("worker {worker} {thread}");
        let read = move || read_all(&reader, worker, generation, &events);
        thread::Builder::new().name(name("reader")).spawn(read).context("no thread to hear a worker")?;
        let write = move || write_all(&writer, &frames);
        thread::Builder::new().name(name("writer")).spawn(write).context("no thread to speak to a worker")?;
        Ok(child)
    }

    /// Sends a frame, after those before it. Does not wait until the child reads it.
    ///
    /// Where the child has gone, [`What::Gone`] says so.
    pub fn send(&self, frame: Frame) {
        // Its writer ends early only when the child has gone.
        let _ = self.outbox.send(frame);
    }

    /// State of the process as Linux names it, such as `S (sleeping)` or `T (stopped)`.
    pub fn state(&self) -> Option<String> {
        let status = fs::read_to_string(format!("/proc/{}/status", self.process.id())).ok()?;
        Some(status.lines().find_map(|line| line.strip_prefix("State:"))?.trim().to_owned())
    }

    /// Returns how a child ended whose channel is closed, with the last lines of its log. Kills it if it does not end.
    pub fn end(mut self) -> String {
        let status = self.ended_within(LAST_WORDS).or_else(|| self.kill());
        format!("{}; {}", describe(status), log_tail(&self.log))
    }

    /// Kills a child that hangs and returns the last lines of its log.
    pub fn end_by_force(mut self) -> String {
        match self.kill() {
            Some(_) => log_tail(&self.log),
            None => format!("process {} does not end; {}", self.process.id(), log_tail(&self.log)),
        }
    }

    fn kill(&mut self) -> Option<ExitStatus> {
        drop(self.process.kill());
        // Both threads end, even if the process does not.
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

impl Drop for Child {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Passes on what a child says until it has gone.
fn read_all(mut stream: &UnixStream, worker: usize, generation: u64, events: &Sender<Event>) {
    loop {
        let what = match receive(&mut stream) {
            Ok(Some(report)) => What::Said(report),
            Ok(None) => What::Gone(None),
            Err(error) => What::Gone(Some(error)),
        };
        let last = matches!(what, What::Gone(_));
        if events.send(Event { worker, generation, what }).is_err() || last {
            break;
        }
    }
}

/// Writes the frames to a child until it, or its [`Child`], has gone.
fn write_all(mut stream: &UnixStream, frames: &Receiver<Frame>) {
    for frame in frames {
        if stream.write_all(&frame).is_err() {
            // So that the reader hears of it, whatever the reason.
            drop(stream.shutdown(Shutdown::Both));
            break;
        }
    }
}

fn describe(status: Option<ExitStatus>) -> String {
    match status.map(|status| (status.code(), status.signal())) {
        Some((Some(code), _)) => format!("exit code {code}"),
        Some((_, Some(9))) => "signal 9 (killed; out of memory?)".to_owned(),
        Some((_, Some(6))) => "signal 6 (aborted, as by an assertion inside SUMO)".to_owned(),
        Some((_, Some(signal))) => format!("signal {signal}"),
        _ => "nobody knows how".to_owned(),
    }
}
