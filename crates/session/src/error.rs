//! The errors of a command, with their exit codes.

use std::fmt;

use crate::machine::way_out;
use dials_core::outside::Busy;

/// An error that a person at the terminal reads.
#[derive(Debug)]
pub enum Error {
    /// A usage error: a bad config, a missing file, a place that cannot be written. Nothing has begun. Exit code 2. But 1
    /// if another process writes the run: the same command may work later.
    Usage(anyhow::Error),
    /// The work failed. Exit code 1.
    Run(anyhow::Error),
    /// Somebody asked to stop. Exit code 130, the shell's code for Ctrl-C.
    Interrupted(String),
}

pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Usage(error) if error.is::<Busy>() => 1,
            Error::Usage(_) => 2,
            Error::Run(_) => 1,
            Error::Interrupted(_) => 130,
        }
    }
}

/// `error: what`, then a line `caused by: why` per cause, then a line `way out: how` for an error of the system.
impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Interrupted(message) => f.write_str(message),
            Error::Usage(error) | Error::Run(error) => {
                write!(f, "error: {error}")?;
                error.chain().skip(1).try_for_each(|cause| write!(f, "\n  caused by: {cause}"))?;
                way_out(&format!("{error:#}")).map_or(Ok(()), |way_out| write!(f, "\n  way out: {way_out}"))
            }
        }
    }
}

impl std::error::Error for Error {}
