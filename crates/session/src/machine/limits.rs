//! Limits of processes, on memory, time and open files, and how much memory and disk the machine has left.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use rustix::fs::statvfs;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Number of files that a command has open, besides those for its child processes.
const OWN_FILES: u64 = 32;

/// Limits this process, and those that it starts, to `more` bytes beyond what it has now. A lower limit stays.
pub fn limit_memory(more: u64) -> Result<()> {
    let used = kib_in("/proc/self/status", "VmSize:");
    let used = used.context("/proc/self/status: does not say the memory of this process")? * 1024;
    let limit = lowest(getrlimit(Resource::As), used.saturating_add(more));
    let limit = Rlimit { current: Some(limit), maximum: Some(limit) };
    setrlimit(Resource::As, limit).context("cannot limit the memory of a process")
}

/// Limits this process to this many seconds of computing, after which the system ends it. A lower limit stays.
pub fn limit_cpu(seconds: u64) -> Result<()> {
    let there = getrlimit(Resource::Cpu);
    let limit = Rlimit { current: Some(lowest(there, seconds)), ..there };
    setrlimit(Resource::Cpu, limit).context("cannot limit the time of a process")
}

fn lowest(there: Rlimit, wanted: u64) -> u64 {
    [there.current, there.maximum].into_iter().flatten().fold(wanted, u64::min)
}

/// Returns the memory that new processes can have, in MiB. `None` if the system does not say.
pub fn free_memory_mib() -> Option<u64> {
    Some(kib_in("/proc/meminfo", "MemAvailable:")? / 1024)
}

/// Returns a figure in KiB of a file of `/proc`; `None` if it is not there.
pub(crate) fn kib_in(file: &str, key: &str) -> Option<u64> {
    let text = fs::read_to_string(file).ok()?;
    let value = text.lines().find_map(|line| line.strip_prefix(key))?;
    value.split_whitespace().next()?.parse().ok()
}

/// Returns the room on the disk of a directory for a user without special rights, in MiB.
pub fn free_disk_mib(dir: &Path) -> Result<u64> {
    let disk = statvfs(dir).with_context(|| format!("{}: cannot be looked at", dir.display()))?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize) >> 20)
}

/// Makes sure that a command may open enough files for child processes that need `each` files here.
/// Raises the soft limit up to the hard one. If that is not enough, the error names `option`, which decides the number.
pub fn allow_open_files(children: usize, each: u64, option: &str) -> Result<()> {
    let needed = OWN_FILES + each * children as u64;
    let limit = getrlimit(Resource::Nofile);
    if limit.current.is_none_or(|soft| soft >= needed) {
        return Ok(());
    }
    ensure!(
        limit.maximum.is_none_or(|hard| hard >= needed),
        "{option} {children}: needs about {needed} open files, but at most {} are allowed (ulimit -Hn); take a smaller \
         number, or raise the limit",
        limit.maximum.unwrap_or_default()
    );
    Ok(setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit })?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_that_is_lower_already_stays() {
        let limits = [(None, None), (Some(40), None), (Some(40), Some(45)), (None, Some(45)), (Some(60), Some(70))];
        let lowest_of_all = limits.map(|(current, maximum)| lowest(Rlimit { current, maximum }, 50));
        assert_eq!(lowest_of_all, [50, 40, 40, 45, 50]);
    }

    #[test]
    fn this_machine_has_memory_and_a_disk_and_no_disk_is_where_nothing_is() {
        assert!(free_memory_mib().unwrap() > 0);
        assert!(free_disk_mib(&std::env::temp_dir()).unwrap() > 0);
        assert!(free_disk_mib(Path::new("/no/such/folder")).unwrap_err().to_string().contains("/no/such/folder"));
    }
}
