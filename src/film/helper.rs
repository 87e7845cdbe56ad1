//! Programs that work for this one and end with it.

use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};
use rustix::process::{Pid, Signal, kill_process_group};

/// The program that ties others to the life of this one.
pub(super) const SETPRIV: &str = "setpriv";

/// A program that ends with this one, however that ends: setpriv asks the system for it and then becomes the program.
pub fn tied(program: &str) -> Command {
    let mut command = Command::new(SETPRIV);
    // Ctrl-C at the terminal is for this program, which ends its helpers in its own time.
    command.args(["--pdeathsig", "TERM", "--", program]).process_group(0).stdin(Stdio::null());
    command
}

/// A program that works for this one. Dropping it ends it and what it has started.
pub struct Helper(pub Child);

impl Helper {
    pub fn start(mut command: Command) -> Result<Helper> {
        Ok(Helper(command.spawn().context("setpriv could not be started")?))
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        // First in a way that lets it clear up, as Xvfb does.
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

/// A file for what a program says.
pub fn listener(file: &Path) -> Result<File> {
    File::create(file).context("the temporary directory cannot be written to")
}
