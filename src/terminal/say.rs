//! Lines for a person: on standard output and standard error, where nobody may be listening any more.

use std::fmt::Display;
use std::io::{ErrorKind, Write, stderr, stdout};

use anyhow::{Context, Result};

/// A line for the person at the terminal, on standard error. That nobody reads it is no reason to stop the work.
pub fn tell(line: impl Display) {
    let _ = stderr().write_all(format!("{line}\n").as_bytes());
}

/// What a command answers, on standard output. A reader that has seen enough, such as `head`, is no error.
pub fn answer(text: impl Display) -> Result<()> {
    let mut out = stdout().lock();
    match out.write_all(format!("{text}\n").as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.context("standard output: cannot be written"),
    }
}
