//! Other programs, which end together with this one.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use rustix::process::{Pid, Signal, kill_process_group};

pub(super) const XVFB: &str = "Xvfb";
/// Program that makes another program end together with this one.
pub(super) const SETPRIV: &str = "setpriv";

/// Returns a command for a program that ends together with this one, by setpriv, however this one ends.
pub(super) fn tied(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(SETPRIV);
    // Ctrl-C at the terminal goes to this program alone, which then ends the others.
    command.args(["--pdeathsig", "TERM", "--"]).arg(program).process_group(0).stdin(Stdio::null());
    command
}

/// A running program. Dropping it ends the program and everything that it has started.
pub(super) struct Program(pub(super) Child);

impl Program {
    pub(super) fn start(mut command: Command) -> Result<Program> {
        Ok(Program(command.spawn().context("setpriv could not be started")?))
    }
}

impl Drop for Program {
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

pub(super) fn log_file(file: &Path) -> Result<File> {
    File::create(file).context("the temporary directory cannot be written to")
}

/// Returns what a program wrote to its [`log_file`]. Programs such as sumo-gui may write any bytes.
pub(super) fn logged(file: &Path) -> String {
    String::from_utf8_lossy(&fs::read(file).unwrap_or_default()).trim().to_owned()
}

/// A virtual screen. Dropping it closes it.
pub(super) struct Screen {
    /// Value of `DISPLAY` for programs on this screen.
    pub(super) name: String,
    _server: Program,
}

impl Screen {
    pub(super) fn open(width: usize, height: usize, folder: &Path) -> Result<Screen> {
        let log = folder.join("screen.txt");
        let mut server = tied(XVFB);
        // Xvfb picks a free screen number and writes it to its standard output when it is ready.
        server.args(["-displayfd", "1", "-nolisten", "tcp", "-screen", "0", &format!("{width}x{height}x24")]);
        server.stdout(Stdio::piped()).stderr(log_file(&log)?);
        let mut server = Program::start(server)?;
        let mut number = String::new();
        let out = server.0.stdout.take().expect("standard output is piped");
        BufReader::new(out).read_line(&mut number).context("cannot read the output of Xvfb")?;
        ensure!(!number.trim().is_empty(), "Xvfb opened no screen: {}", logged(&log));
        Ok(Screen { name: format!(":{}", number.trim()), _server: server })
    }
}
