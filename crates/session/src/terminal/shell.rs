//! Programs as the shell finds them.

use std::path::{Path, PathBuf};

use dials_core::outside::quoted;

const PROGRAM: &str = "dials-traffic";
/// What Linux writes behind the path of a program whose file is another one by now, such as a new build.
const REPLACED: &str = " (deleted)";

/// Returns the name of this program for a command to copy. If the shell would not find it, this is its path.
pub fn program() -> String {
    match std::env::current_exe() {
        Ok(path) if on_the_path(PROGRAM).is_none() => quoted(in_its_place(&path)),
        _ => PROGRAM.to_owned(),
    }
}

/// Returns the path of a program, or of what has replaced it.
fn in_its_place(path: &Path) -> &Path {
    path.to_str().and_then(|path| path.strip_suffix(REPLACED)).map_or(path, Path::new)
}

/// Finds a program on the PATH.
pub fn on_the_path(program: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(program)).find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_was_built_anew_meanwhile_is_named_by_its_place() {
        assert_eq!(in_its_place(Path::new("target/dials-traffic (deleted)")), Path::new("target/dials-traffic"));
        assert_eq!(in_its_place(Path::new("target/dials-traffic")), Path::new("target/dials-traffic"));
    }
}
