//! Memory and CPU time of a process, as Linux counts them, and when a worker's process is replaced by a fresh one.
//!
//! SUMO loses about 2 kB whenever it loads a net, and a worker loads nets for every episode that it plays. So the process
//! of a long run would grow without end. A fresh one continues from the last exchange with the same numbers, as after a
//! death.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

use crate::machine::kib_in;
use dials_learn::fleet::Footprint;

pub(super) fn footprint() -> Footprint {
    let [peak_rss_kib, pss_kib] = [("/proc/self/status", "VmHWM:"), ("/proc/self/smaps_rollup", "Pss:")]
        .map(|(file, key)| kib_in(file, key).unwrap_or(0));
    Footprint { peak_rss_kib, pss_kib }
}

/// Returns the resident memory now, in KiB, shared libraries counted in full; 0 if the system does not report it.
pub(super) fn resident_kib() -> u64 {
    kib_in("/proc/self/status", "VmRSS:").unwrap_or(0)
}

/// A clock of the CPU time of this process, user and system, all threads, from one reading to the next.
pub(super) struct CpuClock(Duration);

impl CpuClock {
    /// Makes a clock that counts from the beginning of the process.
    pub(super) fn of_the_process() -> Self {
        CpuClock(Duration::ZERO)
    }

    pub(super) fn from_now() -> Self {
        CpuClock(cpu_time())
    }

    /// Returns the CPU time since the last call.
    pub(super) fn lap(&mut self) -> Duration {
        let before = std::mem::replace(&mut self.0, cpu_time());
        self.0.saturating_sub(before)
    }
}

fn cpu_time() -> Duration {
    Duration::try_from(clock_gettime(ClockId::ProcessCPUTime)).unwrap_or_default()
}

/// Growth at which the process of a worker is replaced: the larger of the two.
#[derive(Clone, Copy, Debug)]
pub struct MostGrowth {
    pub(crate) kib: u64,
    /// Share of its first size, because the memory of a large process goes up and down by more.
    pub(crate) share: f64,
}

impl Default for MostGrowth {
    /// About 4000 loads of a small net. The start of a worker then costs less than a thousandth of its time.
    fn default() -> Self {
        MostGrowth { kib: 8 << 10, share: 1.0 / 32.0 }
    }
}

#[derive(Default)]
pub(super) struct Growth {
    /// Size after its first period, when everything was loaded once.
    first_kib: Option<u64>,
    now_kib: u64,
}

impl Growth {
    pub(super) fn note(&mut self, resident_kib: u64) {
        self.now_kib = resident_kib;
    }

    /// Ends a period. Returns whether the process has grown by `most` or more since its first one.
    pub(super) fn is_too_much(&mut self, most: MostGrowth) -> bool {
        let first_kib = *self.first_kib.get_or_insert(self.now_kib);
        let most_kib = most.kib.max((first_kib as f64 * most.share) as u64);
        self.now_kib.saturating_sub(first_kib) >= most_kib
    }
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

    /// Returns for each period whether the process is replaced after it; `sizes_kib`: its size at the end of each.
    fn replaced<const N: usize>(sizes_kib: [u64; N]) -> [bool; N] {
        let mut growth = Growth::default();
        sizes_kib.map(|size| {
            growth.note(size);
            growth.is_too_much(MostGrowth::default())
        })
    }

    #[test]
    fn a_process_that_has_grown_since_its_first_period_is_replaced() {
        assert_eq!(replaced([100_000, 101_000, 108_191, 90_000, 108_192]), [false, false, false, false, true]);
        assert_eq!(replaced([400_000, 412_499, 412_500]), [false, false, true]);
    }
}
