//! The errors of a command, with their exit codes.

use std::fmt;
use std::process::ExitCode;

/// An error that a person at the terminal reads.
#[derive(Debug)]
pub enum Error {
    /// A usage error: a bad config, a missing file, a place that cannot be written. Nothing has begun. Exit code 2.
    Usage(anyhow::Error),
    /// The work failed. Exit code 1.
    Run(anyhow::Error),
    /// Somebody asked to stop. Exit code 130, the shell's code for Ctrl-C.
    Interrupted(String),
}

pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Error::Usage(_) => ExitCode::from(2),
            Error::Run(_) => ExitCode::from(1),
            Error::Interrupted(_) => ExitCode::from(130),
        }
    }
}

/// `error: what`, then a line `caused by: why` per cause.
impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Interrupted(message) => f.write_str(message),
            Error::Usage(error) | Error::Run(error) => {
                write!(f, "error: {error}")?;
                error.chain().skip(1).try_for_each(|cause| write!(f, "\n  caused by: {cause}"))
            }
        }
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::anyhow;

    #[test]
    fn the_chain_of_causes_is_told_line_by_line() {
        let error = Error::Run(anyhow!("disk full").context("run.json: cannot be written"));
        assert_eq!(error.to_string(), "error: run.json: cannot be written\n  caused by: disk full");
    }
}
