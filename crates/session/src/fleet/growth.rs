//! How much a worker's process has grown, and when a fresh one takes its place.
//!
//! SUMO loses about 2 kB whenever it loads a net, and a worker loads nets for every episode that it plays. So the process
//! of a long run would grow without end. A fresh one continues from the last exchange with the same numbers, as after a
//! death.

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

/// The resident memory of a worker's process.
#[derive(Default)]
pub(super) struct Growth {
    /// Size after its first period, when everything was loaded once.
    first_kib: Option<u64>,
    now_kib: u64,
}

impl Growth {
    /// Takes the size after an order, in KiB.
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
