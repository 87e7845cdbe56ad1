//! Temporary files and directories, with an error that names the place and the way out.

use std::env;
use std::fs::File;
use std::io::{Error, Result};

use tempfile::TempDir;

use super::Printable;

/// Makes a temporary directory that is removed when it is dropped.
pub fn temporary_dir() -> Result<TempDir> {
    tempfile::tempdir().map_err(|error| cannot_write_temporary(&error))
}

/// Makes a temporary file without a name, so a killed process leaves none behind.
pub fn temporary_file() -> Result<File> {
    tempfile::tempfile().map_err(|error| cannot_write_temporary(&error))
}

/// Returns the error about a temporary file that could not be written, such as one on a full disk.
pub fn cannot_write_temporary(error: &Error) -> Error {
    let message = format!(
        "{}: temporary files cannot be written there ({}); set TMPDIR to a directory that can be written to",
        Printable(env::temp_dir().display()),
        error.kind()
    );
    Error::new(error.kind(), message)
}
