//! Printing to standard output and standard error, even if nobody reads them any more.

use std::fmt::Display;
use std::io::{ErrorKind, Write, stderr, stdout};

use anyhow::{Context, Result};

/// Prints a message on standard error. If that fails, the work continues.
pub fn tell(line: impl Display) {
    let _ = stderr().write_all(format!("{line}\n").as_bytes());
}

/// Prints the result of a command on standard output. If the reader has closed it, as `head` does, this is no error.
pub fn answer(text: impl Display) -> Result<()> {
    let mut out = stdout().lock();
    match out.write_all(format!("{text}\n").as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.context("standard output: cannot be written"),
    }
}
