//! The limit on the number of open files.

use anyhow::{Result, ensure};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Number of files that a command has open, besides those for its child processes.
const OWN: u64 = 32;

/// Makes sure that a command may open enough files for child processes that need `each` files here.
///
/// Raises the soft limit up to the hard one. If that is not enough, the error names `option`, which decides the number.
pub fn allow_open_files(children: usize, each: u64, option: &str) -> Result<()> {
    let needed = OWN + each * children as u64;
    ensure!(
        raise_to(needed)?,
        "{option} {children}: needs about {needed} open files, but at most {} are allowed (ulimit -Hn); take a smaller \
         number, or raise the limit",
        most()
    );
    Ok(())
}

/// Raises the soft limit to the hard one if it is lower than `needed`. Returns whether so many files are allowed.
fn raise_to(needed: u64) -> Result<bool> {
    let limit = getrlimit(Resource::Nofile);
    if limit.current.is_none_or(|soft| soft >= needed) {
        return Ok(true);
    }
    let enough = limit.maximum.is_none_or(|hard| hard >= needed);
    if enough {
        setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit })?;
    }
    Ok(enough)
}

/// Returns the hard limit.
fn most() -> u64 {
    getrlimit(Resource::Nofile).maximum.unwrap_or_default()
}

/// Returns the limit in words for an error message.
pub(super) fn allowed_open_files() -> String {
    getrlimit(Resource::Nofile).current.map_or("a limited number of".to_owned(), |files| files.to_string())
}
