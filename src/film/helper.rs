//! Helper programs, which end together with this one.

use std::fs::{self, File};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};
use rustix::process::{Pid, Signal, kill_process_group};

/// Program that makes another program end together with this one.
pub(super) const SETPRIV: &str = "setpriv";

/// Returns a command for a program that ends together with this one, however this one ends.
///
/// setpriv asks the system for that and then becomes the program.
pub(super) fn tied(program: &str) -> Command {
    let mut command = Command::new(SETPRIV);
    // Ctrl-C at the terminal goes to this program alone, which then ends its helpers.
    command.args(["--pdeathsig", "TERM", "--", program]).process_group(0).stdin(Stdio::null());
    command
}

/// A running helper program. Dropping it ends the program and everything that it has started.
pub(super) struct Helper(pub Child);

impl Helper {
    pub(super) fn start(mut command: Command) -> Result<Helper> {
        Ok(Helper(command.spawn().context("setpriv could not be started")?))
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        // TERM first, so that programs such as Xvfb can clean up.
        for signal in [Signal::TERM, Signal::KILL] {
            for _ in 0..40 {
                if !matches!(self.0.try_wait(), Ok(None)) {
                    return;
                }
                let _ = kill_process_group(Pid::from_child(&self.0), signal);
                thread::sleep(Duration::from_millis(50));
            }
        }
    }
}

/// Creates a file for the output of a program.
pub(super) fn listener(file: &Path) -> Result<File> {
    File::create(file).context("the temporary directory cannot be written to")
}

/// Returns what a program wrote to the file of its [`listener`]. Programs such as sumo-gui may write any bytes.
pub(super) fn heard(file: &Path) -> String {
    String::from_utf8_lossy(&fs::read(file).unwrap_or_default()).trim().to_owned()
}
