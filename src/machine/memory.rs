//! A limit on the memory of a process that reads what may be endless.

use std::fs;

use anyhow::{Context, Result};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Limits this process, and those that it starts, to `more` bytes of memory beyond what it has now. A limit that is
/// lower already stays.
pub fn limit_memory(more: u64) -> Result<()> {
    let wanted = used()?.saturating_add(more);
    let limit = getrlimit(Resource::As).maximum.map_or(wanted, |hard| hard.min(wanted));
    let limit = Rlimit { current: Some(limit), maximum: Some(limit) };
    setrlimit(Resource::As, limit).context("cannot limit the memory of a process")
}

/// Returns the bytes of address space that this process has.
fn used() -> Result<u64> {
    let status = fs::read_to_string("/proc/self/status").context("/proc/self/status: cannot be read")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmSize:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    Ok(kib.context("/proc/self/status: does not say the memory of this process")? * 1024)
}
