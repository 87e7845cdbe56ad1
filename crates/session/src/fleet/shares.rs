//! Which worker owns which agents, and which of the episodes it plays.

use std::ops::Range;

use dials_learn::config::Config;

pub(super) fn names_of(worker: usize, agents: &Range<usize>) -> String {
    match agents.len() {
        0 => format!("worker {worker} (no agents of its own)"),
        1 => format!("worker {worker} (agent {})", agents.start),
        _ => format!("worker {worker} (agents {}..{})", agents.start, agents.end - 1),
    }
}

pub fn agents_of_workers(config: &Config, agents: usize, workers: usize) -> Vec<Range<usize>> {
    let owners = if config.learns_at_one_place() { 1 } else { workers };
    (0..workers).map(|index| if index < owners { share(agents, owners, index) } else { 0..0 }).collect()
}

/// Returns the `index`-th of `parts` nearly equal consecutive shares of `0..total`.
pub(super) fn share(total: usize, parts: usize, index: usize) -> Range<usize> {
    total * index / parts..total * (index + 1) / parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_follow_each_other_and_are_nearly_equal() {
        let shares: Vec<_> = (0..3).map(|index| share(10, 3, index)).collect();
        assert_eq!(shares, [0..3, 3..6, 6..10]);
        assert_eq!((0..4).map(|index| share(2, 4, index).len()).collect::<Vec<_>>(), [0, 1, 0, 1]);
    }
}
