//! The timing of a fixed-time light.

use crate::traffic::light::YELLOW_STEPS;

/// The timing of one light, in steps. It repeats: vertical green, yellow, horizontal green, yellow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// Green for the cars from south and north, at least 1.
    pub vertical: u32,
    /// Green for the cars from west and east, at least 1.
    pub horizontal: u32,
    /// Number of steps from the beginning of the episode to the beginning of a vertical green.
    pub offset: u32,
}

impl Timing {
    pub fn cycle(self) -> u32 {
        self.vertical + self.horizontal + 2 * u32::from(YELLOW_STEPS)
    }

    /// Returns whether the cars from south and north have green at a step, or will have it next.
    pub fn is_vertical(self, step: u32) -> bool {
        let cycle = self.cycle();
        let place = (step + cycle - self.offset % cycle) % cycle;
        let horizontal = self.vertical..self.vertical + u32::from(YELLOW_STEPS) + self.horizontal;
        !horizontal.contains(&place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_goes_round_and_an_offset_shifts_it() {
        let timing = Timing { vertical: 4, horizontal: 2, offset: 0 };
        // Vertical green 0..4, yellow 4..7, horizontal green 7..9, yellow 9..12, and again.
        let vertical = |timing: Timing| (0..24).map(|step| timing.is_vertical(step)).collect::<Vec<_>>();
        let once = [[true; 4].as_slice(), &[false; 5], &[true; 3]].concat();
        assert_eq!(vertical(timing), [once.clone(), once].concat());
        let shifted = vertical(Timing { offset: 5, ..timing });
        assert_eq!(shifted[5..], vertical(timing)[..19]);
        assert_eq!(shifted, vertical(Timing { offset: 17, ..timing }), "whole cycles change nothing");
    }
}
