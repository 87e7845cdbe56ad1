//! One process of an experiment: this program, called with other arguments.

use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{ChildStderr, Command, Stdio};
use std::sync::mpsc::Sender;
use std::thread::JoinHandle;

use anyhow::{Context, Result};
use rustix::process::{Pid, Signal, kill_process};

use super::LOGS;
use super::plan::Task;
use crate::config::{Config, DomainConfig, to_toml};
use crate::records::atomic::write_atomically;
use crate::run::END_WITH;

/// A line that a process said on standard error.
pub struct Said {
    /// Name of its task.
    pub task: String,
    pub line: String,
}

/// A running process.
pub struct Child {
    process: std::process::Child,
    /// Returns the last words that tell why it ended.
    listener: Option<JoinHandle<Option<String>>>,
    /// Where its result goes when it is whole.
    result: Option<PathBuf>,
}

impl Child {
    /// Starts a task. What it says goes to `said` and to its log; what it answers to its result, if that is one.
    pub fn start(task: &Task, folder: &Path, said: Sender<Said>) -> Result<Child> {
        let log = folder.join(LOGS).join(format!("{}.log", task.name));
        let failed = || format!("{}: cannot be written", log.display());
        if let Some((path, config)) = &task.config {
            write_atomically(path, to_toml(&with_absolute_paths(config)?)?.as_bytes())?;
        }
        let file = OpenOptions::new().create(true).append(true).open(&log).with_context(failed)?;
        let stdout = match &task.result {
            Some(result) => Stdio::from(
                File::create(beside(result)).with_context(|| format!("{}: cannot be written", result.display()))?,
            ),
            None => Stdio::from(file.try_clone().with_context(failed)?),
        };
        // Not the path of the program, where another build may stand by now.
        let mut process = Command::new("/proc/self/exe")
            .arg0(std::env::args_os().next().unwrap_or_default())
            .args(&task.arguments)
            .args([END_WITH, &std::process::id().to_string()])
            .stdin(Stdio::null())
            .stdout(stdout)
            .stderr(Stdio::piped())
            // Ctrl-C at the terminal is for the experiment, which asks its runs to stop once.
            .process_group(0)
            .spawn()
            .with_context(|| format!("{}: cannot be started", task.name))?;
        let (stderr, name) = (process.stderr.take().expect("it was asked for"), task.name.clone());
        let listener = Some(std::thread::spawn(move || listen(stderr, file, name, &said)));
        Ok(Child { process, listener, result: task.result.clone() })
    }

    /// To stop where nothing is lost.
    pub fn ask_to_stop(&self) {
        // One that has just ended cannot be asked, and need not.
        let _ = kill_process(Pid::from_child(&self.process), Signal::TERM);
    }

    /// How it ended, if it has: well, or with its last words.
    pub fn ended(&mut self) -> Result<Option<std::result::Result<(), String>>> {
        let Some(status) = self.process.try_wait().context("a process that cannot be waited for")? else {
            return Ok(None);
        };
        // What it said before is no reason for a signal from outside.
        if status.signal().is_some() {
            return Ok(Some(Err(status.to_string())));
        }
        // Its words may come later than its end; and where its workers still hold on to them, it has not ended.
        if self.listener.as_ref().is_some_and(|listener| !listener.is_finished()) {
            return Ok(None);
        }
        let words = self.listener.take().and_then(|listener| listener.join().ok().flatten());
        if !status.success() {
            return Ok(Some(Err(words.unwrap_or(status.to_string()))));
        }
        if let Some(result) = &self.result {
            let failed = || format!("{}: cannot be written", result.display());
            fs::rename(beside(result), result).with_context(failed)?;
        }
        Ok(Some(Ok(())))
    }
}

/// What is being written until it is whole.
fn beside(result: &Path) -> PathBuf {
    result.with_extension("part")
}

/// The config of a run, to be read from another folder.
fn with_absolute_paths(config: &Config) -> Result<Config> {
    let mut config = config.clone();
    for (_, path) in config.domain.iter_mut().flat_map(DomainConfig::paths) {
        *path = std::path::absolute(&path)?;
    }
    Ok(config)
}

fn listen(stderr: ChildStderr, mut log: File, task: String, said: &Sender<Said>) -> Option<String> {
    let mut last = None;
    for line in BufReader::new(stderr).lines().map_while(|line| line.ok()) {
        // Where nobody listens or the disk is full the run goes on.
        let _ = writeln!(log, "{line}");
        if line.starts_with("error: ") || line.starts_with("stopped") {
            last = Some(line.clone());
        }
        let _ = said.send(Said { task: task.clone(), line });
    }
    last
}
