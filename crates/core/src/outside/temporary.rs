//! Temporary files and directories, with an error that names the place and the way out.

use std::env;
use std::fs::File;
use std::io::{Error, Result};
use std::path::Path;

use tempfile::TempDir;

use super::Printable;

/// Makes a temporary directory that is removed when it is dropped.
pub fn temporary_dir() -> Result<TempDir> {
    tempfile::tempdir().map_err(|error| explained(&error, &env::temp_dir()))
}

/// Makes a temporary file without a name, so a killed process leaves none behind.
pub fn temporary_file() -> Result<File> {
    tempfile::tempfile().map_err(|error| explained(&error, &env::temp_dir()))
}

/// Returns the error about a temporary file that could not be written, such as one on a full disk.
pub fn cannot_write_temporary(error: &Error) -> Error {
    explained(error, &env::temp_dir())
}

fn explained(error: &Error, dir: &Path) -> Error {
    let place = Printable(dir.display());
    let message = format!(
        "{place}: temporary files cannot be written there ({}); set TMPDIR to a directory that can be written to",
        error.kind()
    );
    Error::new(error.kind(), message)
}

#[cfg(test)]
mod tests {
    use std::io::ErrorKind;

    use super::*;

    #[test]
    fn the_directory_and_the_way_out_are_named() {
        let error = explained(&Error::from(ErrorKind::StorageFull), Path::new("/full"));
        assert_eq!(
            error.to_string(),
            "/full: temporary files cannot be written there (no storage space); \
             set TMPDIR to a directory that can be written to"
        );
        assert_eq!(error.kind(), ErrorKind::StorageFull);
    }
}
