//! Programs as the shell finds them.

use std::path::PathBuf;

use crate::outside::quoted;

const PROGRAM: &str = "dials-traffic";

/// Returns the name of this program for a command to copy. If the shell would not find it, this is its path.
pub fn program() -> String {
    match std::env::current_exe() {
        Ok(path) if on_the_path(PROGRAM).is_none() => quoted(&path),
        _ => PROGRAM.to_owned(),
    }
}

/// Finds a program on the PATH.
pub fn on_the_path(program: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(program)).find(|path| path.is_file())
}
