//! The program itself, as a child process with a deadline.

use std::fs::{self, File};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use dials_core::outside::is_printable;
use rustix::process::{Pid, Signal, kill_process_group};

use super::driver::deadline;
use super::place::work;

/// What the program said, and its exit code.
pub struct Outcome {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

/// Runs the program in the folder of this process. Panics if it was ended by a signal, panicked, hung, returned an
/// unknown exit code, or said what is not printable.
pub fn run(arguments: &[&str]) -> Outcome {
    run_in(&work(), arguments)
}

pub fn run_in(folder: &Path, arguments: &[&str]) -> Outcome {
    let [stdout, stderr] = ["stdout", "stderr"].map(|name| folder.join(format!(".{name}")));
    let file = |path: &Path| File::create(path).expect("a file to work with");
    let mut command = Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
    command.args(arguments).current_dir(folder).process_group(0);
    command.stdin(Stdio::null()).stdout(file(&stdout)).stderr(file(&stderr));
    let status = wait(command.spawn().expect("the program is built"));
    let text = |path: &Path| fs::read(path).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).expect("a file");
    let (stdout, stderr) = (text(&stdout), text(&stderr));
    let Some(status) = status else { panic!("the program hangs with {arguments:?}: {stderr}") };
    let said = || format!("with {arguments:?}, and said: {}", stderr.chars().take(2_000).collect::<String>());
    if let Some(signal) = status.signal() {
        panic!("the program was ended by signal {signal} {}", said());
    }
    let code = status.code().expect("a process without a signal has an exit code");
    assert!([0, 1, 2].contains(&code) && !stderr.contains("panicked at"), "the program ended with {code} {}", said());
    let bad = stdout.chars().chain(stderr.chars()).find(|&letter| letter != '\n' && !is_printable(letter));
    assert!(bad.is_none(), "the program printed {bad:?} {}", said());
    Outcome { code, stdout, stderr }
}

/// Waits for a process, up to the deadline of an input. After that: `None`.
fn wait(mut child: Child) -> Option<ExitStatus> {
    let begun = Instant::now();
    while begun.elapsed() < deadline() {
        if let Some(status) = child.try_wait().expect("a child of this process") {
            return Some(status);
        }
        std::thread::sleep(Duration::from_millis(3));
    }
    end(&mut child);
    None
}

/// Ends a child process that leads a group, and all processes of the group.
pub fn end(child: &mut Child) {
    let group = Pid::from_child(child);
    // It may have ended by itself just now.
    let _ = kill_process_group(group, Signal::KILL);
    let _ = child.wait();
}
