//! Where and when items appear: one random stream per shelf.
//!
//! A stream advances at every step, whether its shelf is free or not. It depends on the shelf's place in the warehouse.
//! So an LS that draws from the streams of the GS sees the same items appear.

use super::region::Age;
use dials_core::base::{RandomPurpose, Seed, scramble};

/// Probability that an item appears on a free shelf in a step (the paper).
const APPEARANCE: f64 = 0.02;
const THRESHOLD: u64 = (APPEARANCE * u64::MAX as f64) as u64;

/// The state of one shelf's stream: SplitMix64 (Steele et al. 2014). It takes eight bytes, so a region's twelve fit
/// into two cache lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Appearances(u64);

impl Appearances {
    /// Returns the stream of a shelf in one episode, by its row and column in the warehouse.
    pub(crate) fn of_shelf(episode: Seed, row: usize, col: usize) -> Self {
        let place = (((row as u64) << 32 | col as u64) + 1).wrapping_mul(0x9e6c_63d0_876a_68de);
        // Neighbouring shelves differ in few bits before the scrambling, and in half of them after it.
        Appearances(scramble(episode.bits() ^ place))
    }

    /// Returns whether an item appears in this step if the shelf is free.
    pub(crate) fn draw(&mut self) -> bool {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        scramble(self.0) < THRESHOLD
    }
}

/// Lets items appear on free shelves, also on those emptied in this step.
pub(crate) fn appear(ages: &mut [Age], appearances: &mut [Appearances]) {
    for (age, appearances) in ages.iter_mut().zip(appearances) {
        let appears = appearances.draw();
        if *age < 0 && appears {
            *age = 0;
        }
    }
}

/// Returns the seed of the items of one episode of one copy. The GS passes the seed of its episode as `simulator`, and
/// 0 for the others. So an LS made with that seed has the GS's items in the first episode of its first copy.
pub(crate) fn episode(simulator: Seed, copy: usize, episode: u64) -> Seed {
    simulator.fork(RandomPurpose::Items).for_copy(copy).for_episode(episode as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_draws_of_many_episodes_have_the_same_probability_too() {
        // 1000 expected, standard deviation 31.
        let seeds: [fn(u64) -> Seed; 2] = [
            |number| episode(Seed::new(6), 0, number),
            |number| episode(Seed::new(6).for_episode(number as usize), 0, 0),
        ];
        for (row, col) in [(0, 1), (4, 7), (5, 8), (7, 4)] {
            for seed in seeds {
                let count = (0..50_000).filter(|&number| Appearances::of_shelf(seed(number), row, col).draw()).count();
                assert!(count.abs_diff(1000) < 130, "{row} {col}: {count}");
            }
        }
    }
}
