//! Memory and CPU time of this process, as Linux counts them.

use std::fs;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

use dials_learn::fleet::Footprint;

/// Measures the memory of this process.
pub(super) fn footprint() -> Footprint {
    Footprint { peak_rss_kib: field("/proc/self/status", "VmHWM:"), pss_kib: field("/proc/self/smaps_rollup", "Pss:") }
}

/// Returns the resident memory of this process now, in KiB, shared libraries counted in full; 0 if the system does not
/// report it.
pub(super) fn resident_kib() -> u64 {
    field("/proc/self/status", "VmRSS:")
}

/// A clock of the CPU time of this process, user and system, all threads, from one reading to the next.
pub(super) struct CpuClock {
    last: Duration,
}

impl CpuClock {
    /// Makes a clock that counts from the beginning of the process.
    pub(super) fn of_the_process() -> Self {
        CpuClock { last: Duration::ZERO }
    }

    /// Makes a clock that counts from now on.
    pub(super) fn from_now() -> Self {
        CpuClock { last: cpu_time() }
    }

    /// Returns the CPU time since the last call.
    pub(super) fn lap(&mut self) -> Duration {
        let now = cpu_time();
        let lap = now.saturating_sub(self.last);
        self.last = now;
        lap
    }
}

fn cpu_time() -> Duration {
    Duration::try_from(clock_gettime(ClockId::ProcessCPUTime)).unwrap_or_default()
}

fn field(file: &str, key: &str) -> u64 {
    let text = fs::read_to_string(file).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(key));
    line.and_then(|value| value.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_knows_its_memory() {
        let footprint = footprint();
        assert!(footprint.peak_rss_kib > 1000 && footprint.pss_kib > 1000, "{footprint:?}");
        assert!(resident_kib() > 1000);
    }

    #[test]
    fn every_thread_counts_in_the_cpu_time_and_no_reading_counts_twice() {
        let mut clock = CpuClock::from_now();
        let work = || (0..200_000_u64).fold(0_u64, |sum, i| std::hint::black_box(sum.wrapping_add(i * i)));
        std::thread::spawn(work).join().unwrap();
        assert!(clock.lap() > Duration::ZERO);
        assert!(CpuClock::of_the_process().lap() > Duration::ZERO);
    }
}
