//! The clock of a light: its timing, and how far it may leave it.

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

    /// Returns the number of steps from a step to the next one at which the clock asks for the other green, at least 1.
    pub fn until_change(self, step: u32) -> u32 {
        let until = self.to_changes(step).map(|steps| if steps == 0 { self.cycle() } else { steps });
        until[0].min(until[1])
    }

    /// Returns the number of steps since the clock last began to ask for another green: 0 at the step of the change.
    pub fn since_change(self, step: u32) -> u32 {
        let cycle = self.cycle();
        let since = self.to_changes(step).map(|steps| (cycle - steps) % cycle);
        since[0].min(since[1])
    }

    /// Returns the number of steps until the clock asks for horizontal and for vertical green: 0 if it begins to now.
    fn to_changes(self, step: u32) -> [u32; 2] {
        let cycle = self.cycle();
        let place = (step % cycle + cycle - self.offset % cycle) % cycle;
        let to_vertical = self.vertical + u32::from(YELLOW_STEPS) + self.horizontal;
        [self.vertical, to_vertical].map(|change| (change + cycle - place) % cycle)
    }
}

/// Number of steps by which a light may leave its clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leeway {
    /// To give an unused green away.
    pub early: u32,
    /// To hold a green for a car that is almost there.
    pub late: u32,
}

impl Leeway {
    /// No leeway, as fixed-time lights have.
    pub const NONE: Leeway = Leeway { early: 0, late: 0 };
    /// The most steps of either kind.
    pub const MOST: u32 = 60;
}

/// Returns the leeway that is best on 5x5 with 10 steps of green: 5 early or 4 late are worse there.
impl Default for Leeway {
    fn default() -> Self {
        Leeway { early: 3, late: 2 }
    }
}

/// What lights that go by the clock follow: one timing per intersection, and the same leeway for all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClockPlan {
    pub timings: Vec<Timing>,
    pub leeway: Leeway,
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

    #[test]
    fn the_clock_says_when_it_changes() {
        let timing = Timing { vertical: 4, horizontal: 2, offset: 5 };
        for step in 5..60 {
            let changes = |step: u32| timing.is_vertical(step) != timing.is_vertical(step - 1);
            let until = (1..).find(|steps| changes(step + steps)).expect("it goes round");
            let since = (0..).find(|steps| changes(step + 12 - steps)).expect("it goes round");
            assert_eq!((timing.until_change(step), timing.since_change(step)), (until, since), "step {step}");
        }
    }
}
