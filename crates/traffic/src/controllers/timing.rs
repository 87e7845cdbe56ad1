//! The clock of a light: its timing, and how far it may leave it.

use crate::agents::phase_plan::PhasePlan;

/// The timing of one light, in steps. It repeats: each green in the order of the light's program, and what is shown
/// between two greens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Timing {
    /// Length of each green; 0 for a green that is left out.
    greens: Vec<u32>,
    /// Number of steps from the beginning of the episode to the beginning of the first green.
    offset: u32,
    /// Greens that are shown, in their order, with the places in the cycle at which they end. The clock then asks for
    /// the next one.
    ends: Vec<(usize, u32)>,
    cycle: u32,
}

impl Timing {
    /// Makes a timing of a light with these phases. `greens`: the length of each green, 0 to leave it out; one of them
    /// at least is above 0.
    pub(crate) fn new(phases: &PhasePlan, greens: &[u32], offset: u32) -> Timing {
        assert_eq!(greens.len(), phases.greens().len(), "a length for each green");
        let shown: Vec<usize> = (0..greens.len()).filter(|&green| greens[green] > 0).collect();
        assert!(!shown.is_empty(), "a light shows some green");
        let (mut ends, mut cycle) = (Vec::with_capacity(shown.len()), 0);
        for (place, &green) in shown.iter().enumerate() {
            cycle += greens[green];
            ends.push((green, cycle));
            cycle += phases.clearing_steps(green, shown[(place + 1) % shown.len()]);
        }
        Timing { greens: greens.to_vec(), offset, ends, cycle }
    }

    /// Returns the length of each green, 0 for a green that is left out.
    pub(crate) fn greens(&self) -> &[u32] {
        &self.greens
    }

    pub(crate) fn offset(&self) -> u32 {
        self.offset
    }

    pub(crate) fn cycle(&self) -> u32 {
        self.cycle
    }

    /// Returns the same timing with another offset.
    pub(crate) fn shifted(&self, offset: u32) -> Timing {
        Timing { offset, ..self.clone() }
    }

    /// Returns the green that the clock asks for at a step: it is shown or comes next.
    pub fn target(&self, step: u32) -> usize {
        let place = self.place(step);
        let asked_for = self.ends.iter().find(|&&(_, end)| place < end).unwrap_or(&self.ends[0]);
        asked_for.0
    }

    /// Returns the green that the clock asks for after this one.
    pub(crate) fn after(&self, green: usize) -> usize {
        let next = self.ends.iter().find(|&&(shown, _)| shown > green).unwrap_or(&self.ends[0]);
        next.0
    }

    /// Returns the number of steps from a step to the next one at which the clock asks for another green, at least 1.
    pub fn until_change(&self, step: u32) -> u32 {
        let place = self.place(step);
        let until = |&(_, end): &(usize, u32)| if end > place { end - place } else { end + self.cycle - place };
        self.ends.iter().map(until).min().expect("a light shows some green")
    }

    /// Returns the number of steps since the clock last began to ask for another green: 0 at the step of the change.
    pub fn since_change(&self, step: u32) -> u32 {
        let place = self.place(step);
        let since = |&(_, end): &(usize, u32)| if end <= place { place - end } else { place + self.cycle - end };
        self.ends.iter().map(since).min().expect("a light shows some green")
    }

    /// Returns the number of steps since the last beginning of a cycle.
    fn place(&self, step: u32) -> u32 {
        (step % self.cycle + self.cycle - self.offset % self.cycle) % self.cycle
    }
}

/// Number of steps by which a light may leave its clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Leeway {
    /// To give an unused green away.
    pub(crate) early: u32,
    /// To hold a green for a car that is almost there.
    pub(crate) late: u32,
}

impl Leeway {
    /// No leeway, as fixed-time lights have.
    pub(crate) const NONE: Leeway = Leeway { early: 0, late: 0 };
    /// The most steps of either kind.
    pub(crate) const MOST: u32 = 60;
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
    pub(crate) leeway: Leeway,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::{crossing, middle};

    #[test]
    fn the_clock_goes_round_and_an_offset_shifts_it() {
        let timing = Timing::new(&middle().phases, &[4, 2], 0);
        // Green 0 at 0..4, yellow 4..7, green 1 at 7..9, yellow 9..12, and again.
        let targets = |timing: &Timing| (0..24).map(|step| timing.target(step)).collect::<Vec<_>>();
        let once = [[0; 4].as_slice(), &[1; 5], &[0; 3]].concat();
        assert_eq!(targets(&timing), [once.clone(), once].concat());
        let shifted = targets(&timing.shifted(5));
        assert_eq!(shifted[5..], targets(&timing)[..19]);
        assert_eq!(shifted, targets(&timing.shifted(17)), "whole cycles change nothing");
    }

    #[test]
    fn a_green_of_no_length_is_left_out() {
        // Four steps between two greens: green 0 at 0..5, green 2 at 9..16, green 3 at 20..23, and 0 again at 27.
        let timing = Timing::new(&crossing().phases, &[5, 0, 7, 3], 0);
        assert_eq!(timing.cycle(), 27);
        assert_eq!([4, 5, 15, 16, 22, 23, 26].map(|step| timing.target(step)), [0, 2, 2, 3, 3, 0, 0]);
        assert_eq!([0, 1, 2, 3].map(|green| timing.after(green)), [2, 2, 3, 0]);
    }

    #[test]
    fn the_clock_says_when_it_changes() {
        for timing in [Timing::new(&middle().phases, &[4, 2], 5), Timing::new(&crossing().phases, &[5, 0, 7, 3], 31)] {
            let cycle = timing.cycle();
            for step in cycle..5 * cycle {
                let changes = |step: u32| timing.target(step) != timing.target(step - 1);
                let until = (1..).find(|steps| changes(step + steps)).expect("it goes round");
                let since = (0..).find(|steps| changes(step + cycle - steps)).expect("it goes round");
                assert_eq!((timing.until_change(step), timing.since_change(step)), (until, since), "step {step}");
            }
        }
    }
}
