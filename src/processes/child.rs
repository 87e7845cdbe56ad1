//! One child process: its birth, its channel, its end.

use std::fs::OpenOptions;
use std::io::Write;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;

use anyhow::{Context, Result};

use super::channel::receive;
use super::message::Report;

/// The hidden subcommand that makes this program a worker.
const WORKER: &str = "worker";
/// Lines of a log that an error message shows.
const TAIL: usize = 8;

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
    stream: UnixStream,
    log: PathBuf,
}

impl Child {
    /// Starts this program as a worker; what it says goes to `events`, what it prints to `log`.
    pub fn spawn(worker: usize, generation: u64, log: &Path, events: Sender<Event>) -> Result<Child> {
        let (stream, theirs) = UnixStream::pair().context("no socket for a worker")?;
        let opened = OpenOptions::new().create(true).append(true).open(log);
        let log_file = opened.with_context(|| format!("{}: cannot be written", log.display()))?;
        // Not the path of the program, where another build may stand by now.
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
        let mut reader = stream.try_clone()?;
        std::thread::spawn(move || {
            loop {
                let what = match receive(&mut reader) {
                    Ok(Some(report)) => What::Said(report),
                    Ok(None) => What::Gone(None),
                    Err(error) => What::Gone(Some(error)),
                };
                let last = matches!(what, What::Gone(_));
                if events.send(Event { worker, generation, what }).is_err() || last {
                    break;
                }
            }
        });
        Ok(Child { process, stream, log: log.to_owned() })
    }

    /// Sends an encoded message. An error means that the child has gone, or is going.
    pub fn send(&mut self, frame: &[u8]) -> std::io::Result<()> {
        self.stream.write_all(frame)
    }

    /// Makes sure that it has ended and tells how, with the last lines of its log.
    pub fn end(mut self) -> String {
        // A child whose channel closed is ending by itself; one that hangs is not.
        let status = self.ended_by_itself().or_else(|| {
            drop(self.process.kill());
            self.process.wait().ok()
        });
        format!("{}; {}", describe(status), tail(&self.log))
    }

    fn ended_by_itself(&mut self) -> Option<ExitStatus> {
        for _ in 0..20 {
            if let Ok(Some(status)) = self.process.try_wait() {
                return Some(status);
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        None
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        drop(self.process.kill());
        drop(self.process.wait());
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

fn tail(log: &Path) -> String {
    let bytes = std::fs::read(log).unwrap_or_default();
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<&str> = text.lines().collect();
    let last = &lines[lines.len().saturating_sub(TAIL)..];
    format!("last lines of {}:\n    {}", log.display(), last.join("\n    "))
}
