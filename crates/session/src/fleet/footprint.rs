//! Memory and CPU time of this process, as Linux counts them.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

use crate::machine::kib_in;
use dials_learn::training::answers::Footprint;

/// Measures the memory of this process.
pub(super) fn footprint() -> Footprint {
    let [peak_rss_kib, pss_kib] = [("/proc/self/status", "VmHWM:"), ("/proc/self/smaps_rollup", "Pss:")]
        .map(|(file, key)| kib_in(file, key).unwrap_or(0));
    Footprint { peak_rss_kib, pss_kib }
}

/// Returns the resident memory of this process now, in KiB, shared libraries counted in full; 0 if the system does not
/// report it.
pub(super) fn resident_kib() -> u64 {
    kib_in("/proc/self/status", "VmRSS:").unwrap_or(0)
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
