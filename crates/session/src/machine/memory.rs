//! Limits on the memory and the time of a process that reads what may be endless.

use std::fs;

use anyhow::{Context, Result};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Limits this process, and those that it starts, to `more` bytes of memory beyond what it has now. A limit that is
/// lower already stays, the soft one, too.
pub fn limit_memory(more: u64) -> Result<()> {
    let limit = lowest(getrlimit(Resource::As), used()?.saturating_add(more));
    let limit = Rlimit { current: Some(limit), maximum: Some(limit) };
    setrlimit(Resource::As, limit).context("cannot limit the memory of a process")
}

/// Limits this process to this many seconds of computing, after which the system ends it. A limit that is
/// lower already stays.
pub fn limit_cpu(seconds: u64) -> Result<()> {
    let there = getrlimit(Resource::Cpu);
    let limit = Rlimit { current: Some(lowest(there, seconds)), ..there };
    setrlimit(Resource::Cpu, limit).context("cannot limit the time of a process")
}

fn lowest(there: Rlimit, wanted: u64) -> u64 {
    [there.current, there.maximum].into_iter().flatten().fold(wanted, u64::min)
}

/// Returns the bytes of address space that this process has.
fn used() -> Result<u64> {
    let status = fs::read_to_string("/proc/self/status").context("/proc/self/status: cannot be read")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmSize:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    Ok(kib.context("/proc/self/status: does not say the memory of this process")? * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_that_is_lower_already_stays() {
        for (current, maximum, lowest_of_all) in [
            (None, None, 50),
            (Some(40), None, 40),
            (Some(40), Some(45), 40),
            (None, Some(45), 45),
            (Some(60), Some(70), 50),
        ] {
            assert_eq!(lowest(Rlimit { current, maximum }, 50), lowest_of_all, "{current:?} {maximum:?}");
        }
    }
}
