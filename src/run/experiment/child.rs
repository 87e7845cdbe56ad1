//! One process of an experiment: this program, started with other arguments.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, Write};
use std::os::unix::process::CommandExt;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc::Sender;
use std::thread::{self, JoinHandle};

use anyhow::{Context, Result};
use rustix::process::{Pid, Signal, kill_process};

use super::plan::PlannedWork;
use dials_core::outside::Directory;
use dials_session::config::{RunConfig, to_toml};
use dials_session::experiment::LOGS;
use dials_session::fleet::Log;
use dials_session::machine::why_aborted;
use dials_session::parent::END_WITH;
use dials_session::records::find::BASELINES;

/// A line that a process printed on standard error.
pub(super) struct Said {
    pub task: String,
    pub line: String,
}

/// Number of the signal by which a process aborts.
const ABORTED: i32 = 6;

pub(super) struct RunProcess {
    process: std::process::Child,
    /// Thread that returns the last words of the process: why it ended.
    listener: Option<JoinHandle<Option<String>>>,
    /// What it printed on standard error.
    log: Log,
    result: Option<Output>,
}

/// What a process prints on standard output, and the file that gets it once it is complete.
struct Output {
    printed: File,
    folder: Directory,
    name: String,
}

impl Output {
    fn complete(&mut self) -> Result<()> {
        let Output { printed, folder, name } = self;
        let mut text = Vec::new();
        let read = printed.rewind().and_then(|()| printed.read_to_end(&mut text)).map_err(anyhow::Error::from);
        read.and_then(|_| folder.write(name, &text))
            .with_context(|| format!("{name}: its measurement cannot be written"))
    }
}

impl RunProcess {
    /// Starts a task. Its standard error goes to `said` and to its log. Its standard output goes to its result file, if
    /// it has one, otherwise to the log. `folder`: folder of the experiment's runs.
    pub(super) fn start(task: &PlannedWork, folder: &Directory, said: Sender<Said>) -> Result<RunProcess> {
        let log = Log::open(&folder.make_subdirectory(LOGS)?, format!("{}.log", task.name))?;
        if let Some((path, config)) = &task.config {
            let text = to_toml(&with_absolute_paths(config)?)?;
            folder.make_subdirectory(BASELINES)?.write(name_of(path)?, text.as_bytes())?;
        }
        let file = log.file()?;
        let (result, stdout) = match &task.result {
            Some(result) => {
                let printed =
                    tempfile::tempfile().context("the result of a process has no place until it is complete")?;
                let (stdout, name) = (printed.try_clone()?, name_of(result)?.to_owned());
                let within = name_of(result.parent().context("a result is in a folder")?)?;
                (Some(Output { printed, folder: folder.make_subdirectory(within)?, name }), stdout)
            }
            None => (None, log.file()?),
        };
        // Not the path of the program: another build may be there by now.
        let mut process = Command::new("/proc/self/exe")
            .arg0(std::env::args_os().next().unwrap_or_default())
            .args(&task.arguments)
            .args([END_WITH, &std::process::id().to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::from(stdout))
            .stderr(Stdio::piped())
            // Ctrl-C at the terminal goes to the experiment alone, which then asks its runs to stop.
            .process_group(0)
            .spawn()
            .with_context(|| format!("{}: cannot be started", task.name))?;
        let (stderr, name) = (process.stderr.take().expect("it was asked for"), task.name.clone());
        let listener = thread::Builder::new().name(format!("{} listener", task.name));
        match listener.spawn(move || listen(stderr, file, name, &said)) {
            Ok(listener) => Ok(RunProcess { process, listener: Some(listener), log, result }),
            Err(error) => {
                drop(process.kill());
                drop(process.wait());
                Err(error).with_context(|| format!("{}: cannot start the thread that reads from it", task.name))
            }
        }
    }

    pub(super) fn ask_to_stop(&self) {
        // If the process has just ended, the signal fails, which does no harm.
        let _ = kill_process(Pid::from_child(&self.process), Signal::TERM);
    }

    /// Returns how the process ended: well, or with the lines of an error. `None`: it is still running.
    pub(super) fn ended(&mut self) -> Result<Option<std::result::Result<(), String>>> {
        let Some(status) = self.process.try_wait().context("cannot wait for a process")? else {
            return Ok(None);
        };
        // An earlier line does not explain a signal from outside.
        if status.signal().is_some_and(|signal| signal != ABORTED) {
            return Ok(Some(Err(status.to_string())));
        }
        // Its last lines may arrive after its end. If its workers still hold the pipe open, it has not ended.
        if self.listener.as_ref().is_some_and(|listener| !listener.is_finished()) {
            return Ok(None);
        }
        if status.signal() == Some(ABORTED) {
            return Ok(Some(Err(format!("{status}: {}", why_aborted(&self.log.tail())))));
        }
        let words = self.listener.take().and_then(|listener| listener.join().ok().flatten());
        if !status.success() {
            return Ok(Some(Err(words.unwrap_or(status.to_string()))));
        }
        self.result.as_mut().map_or(Ok(()), Output::complete)?;
        Ok(Some(Ok(())))
    }
}

/// Notes in the log of a task why it cannot begin.
pub(super) fn log_obstacle(task: &str, why: &str, folder: &Directory) -> Result<()> {
    let log = Log::open(&folder.make_subdirectory(LOGS)?, format!("{task}.log"))?;
    writeln!(log.file()?, "error: {why}").with_context(|| format!("{task}: its log cannot be written"))
}

fn name_of(file: &Path) -> Result<&str> {
    file.file_name().and_then(OsStr::to_str).context("a file of an experiment has no name")
}

fn with_absolute_paths(config: &RunConfig) -> Result<RunConfig> {
    let mut config = config.clone();
    for (_, path) in config.domain.iter_mut().flat_map(|domain| domain.table_mut().paths()) {
        *path = std::path::absolute(&path)?;
    }
    Ok(config)
}

/// Passes on and logs what a process prints. Returns its last words: the last line that says why it ended, with the
/// indented lines right after it, which are its causes and the way out.
fn listen(stderr: impl Read, mut log: File, task: String, said: &Sender<Said>) -> Option<String> {
    let mut last_words: Option<String> = None;
    // Whether an indented line still belongs to them.
    let mut open = false;
    // Libraries of the process may print bytes that are no UTF-8.
    for line in BufReader::new(stderr).split(b'\n').map_while(|line| line.ok()) {
        let line = String::from_utf8_lossy(&line).trim_end_matches('\r').to_owned();
        // If the disk is full or the receiver has gone, the run continues.
        let _ = writeln!(log, "{line}");
        if line.starts_with("error: ") || line.starts_with("stopped") {
            last_words = Some(line.clone());
            open = true;
        } else {
            open &= line.starts_with("  ");
            last_words.iter_mut().filter(|_| open).for_each(|words| words.extend(["\n", &line]));
        }
        let _ = said.send(Said { task: task.clone(), line });
    }
    last_words
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn the_last_words_of_a_process_have_their_causes_and_the_way_out_and_all_lines_are_passed_on() {
        let error = "error: run.json: cannot be written\n  caused by: disk full\n  way out: make room";
        let earlier = format!("error: an earlier one\n  caused by: a\n{error}\ngoodbye\n  not of the error\n");
        for (printed, words) in [
            (format!("step 1/2: slow\n  a note\n{error}\n").as_bytes(), Some(error)),
            (earlier.as_bytes(), Some(error)),
            (b"stopped; kept up to step 5\n", Some("stopped; kept up to step 5")),
            (b"step 1/2: slow\n  a note\n", None),
            // Bytes that are no text do not end the listening.
            (b"edge \xff is odd\r\nerror: disk full\n  make room", Some("error: disk full\n  make room")),
        ] {
            let (said, heard) = channel();
            let found = listen(printed, tempfile::tempfile().unwrap(), "a".to_owned(), &said);
            drop(said);
            assert_eq!(found.as_deref(), words);
            let lines: Vec<String> = heard.iter().map(|said| said.line).collect();
            let text = String::from_utf8_lossy(printed).replace('\r', "");
            assert_eq!(lines, text.lines().collect::<Vec<_>>());
        }
    }
}
