//! How much memory this process takes, as Linux counts it.

use std::fs;

use serde::{Deserialize, Serialize};

/// Memory of a process, in KiB; 0 where the system does not tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Footprint {
    /// The most resident memory it ever had, shared libraries counted in full.
    pub peak_rss_kib: u64,
    /// Its proportional share: shared pages count once among those who share them, so these add up.
    pub pss_kib: u64,
}

impl Footprint {
    /// The larger of each figure.
    pub fn max(self, other: Footprint) -> Footprint {
        Footprint { peak_rss_kib: self.peak_rss_kib.max(other.peak_rss_kib), pss_kib: self.pss_kib.max(other.pss_kib) }
    }

    pub fn of_this_process() -> Self {
        Footprint {
            peak_rss_kib: field("/proc/self/status", "VmHWM:"),
            pss_kib: field("/proc/self/smaps_rollup", "Pss:"),
        }
    }
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
        let footprint = Footprint::of_this_process();
        assert!(footprint.peak_rss_kib > 1000 && footprint.pss_kib > 1000, "{footprint:?}");
    }
}
