//! Lights that go by the clock: their timings, and the controller that follows them. With offsets that suit the roads,
//! cars meet green after green. Coordinated lights have some leeway, too: they give an unused green away some steps
//! early, and hold a green some steps for a car that is almost there.

use super::{Intersection, Intersections, LightController};
use crate::agents::phase_plan::PhasePlan;
use dials_core::base::Seed;

/// Distances before the stop line within which a car uses a green, wants another one, and has a green held for it.
const USED_M: f64 = 40.0;
const WANTED_M: f64 = 50.0;
const HELD_M: f64 = 30.0;

/// The timing of one light, in steps. It repeats.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Timing {
    /// Number of steps for which cars have each green; 0 for a green that is left out.
    greens: Vec<u32>,
    /// Number of steps from the beginning of the episode to the beginning of the first green.
    offset: u32,
    /// Greens that are shown, in their order.
    shown: Vec<ShownGreen>,
    cycle: u32,
}

/// A green of a timing, with places in the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct ShownGreen {
    green: usize,
    begin: u32,
    /// Where the light leaves it. Cars then keep it while people on foot end their way across.
    end: u32,
}

impl Timing {
    /// `greens`: for how long cars have each green, 0 to leave it out; one of them at least is above 0. Where people walk, they
    /// are those of [`PhasePlan::fitted`].
    pub(crate) fn new(phases: &PhasePlan, greens: &[u32], offset: u32) -> Timing {
        let shown: Vec<usize> = (0..greens.len()).filter(|&green| greens[green] > 0).collect();
        Timing::in_order(phases, greens, &shown, offset)
    }

    /// Like [`Timing::new`], with the greens that are shown in this order: each with a length above 0, once.
    pub(crate) fn in_order(phases: &PhasePlan, greens: &[u32], shown: &[usize], offset: u32) -> Timing {
        assert_eq!(greens.len(), phases.greens().len(), "a length for each green");
        assert!(!shown.is_empty(), "a light shows some green");
        assert_eq!(shown.len(), greens.iter().filter(|&&green| green > 0).count(), "each green once");
        let mut begin = 0;
        let in_turn = |(place, &green): (usize, &usize)| {
            let next = shown[(place + 1) % shown.len()];
            // A fitted green is longer than the end of its walk, but for a fixed order that leaves greens out.
            let stay = greens[green].saturating_sub(phases.walk_end_steps(green, next)).max(1);
            let found = ShownGreen { green, begin, end: begin + stay };
            begin = found.end + phases.clearing_steps(green, next);
            found
        };
        let in_turn: Vec<ShownGreen> = shown.iter().enumerate().map(in_turn).collect();
        Timing { greens: greens.to_vec(), offset, shown: in_turn, cycle: begin }
    }

    pub(crate) fn greens(&self) -> &[u32] {
        &self.greens
    }

    pub(crate) fn offset(&self) -> u32 {
        self.offset
    }

    /// Returns whether a light that has played this timing so far can go on with the other one: only their offsets may differ.
    pub(crate) fn repeats(&self, other: &Timing) -> bool {
        self.greens == other.greens && self.shown == other.shown
    }

    pub(crate) fn cycle(&self) -> u32 {
        self.cycle
    }

    /// Returns the greens that are shown, in their order.
    pub(crate) fn order(&self) -> impl Iterator<Item = usize> + '_ {
        self.shown.iter().map(|shown| shown.green)
    }

    /// Returns the place in the cycle at which a green begins that is shown.
    pub(crate) fn begin_of(&self, green: usize) -> u32 {
        self.shown.iter().find(|shown| shown.green == green).map_or(0, |shown| shown.begin)
    }

    /// Returns the number of steps after which the light leaves a green that is shown.
    pub(crate) fn stay_in(&self, green: usize) -> u32 {
        self.shown.iter().find(|shown| shown.green == green).map_or(0, |shown| shown.end - shown.begin)
    }

    /// Returns the same greens in the same order, with other lengths.
    pub(crate) fn with_lengths(&self, phases: &PhasePlan, greens: &[u32]) -> Timing {
        Timing::in_order(phases, greens, &self.order().collect::<Vec<_>>(), self.offset)
    }

    pub(crate) fn shifted(&self, offset: u32) -> Timing {
        Timing { offset, ..self.clone() }
    }

    /// Returns the green that the clock asks for at a step: it is shown or comes next.
    pub fn target(&self, step: u32) -> usize {
        let place = self.place(step);
        self.shown.iter().find(|shown| place < shown.end).unwrap_or(&self.shown[0]).green
    }

    pub(crate) fn after(&self, green: usize) -> usize {
        let next = match self.shown.iter().position(|shown| shown.green == green) {
            Some(place) => &self.shown[(place + 1) % self.shown.len()],
            None => self.shown.iter().find(|shown| shown.green > green).unwrap_or(&self.shown[0]),
        };
        next.green
    }

    /// Returns the number of steps from a step to the next one at which the clock asks for another green, at least 1.
    pub fn until_change(&self, step: u32) -> u32 {
        let place = self.place(step);
        let until = |end: u32| if end > place { end - place } else { end + self.cycle - place };
        self.shown.iter().map(|shown| until(shown.end)).min().expect("a light shows some green")
    }

    /// Returns the number of steps since the clock last began to ask for another green: 0 at the step of the change.
    pub fn since_change(&self, step: u32) -> u32 {
        let place = self.place(step);
        let since = |end: u32| if end <= place { place - end } else { place + self.cycle - end };
        self.shown.iter().map(|shown| since(shown.end)).min().expect("a light shows some green")
    }

    fn place(&self, step: u32) -> u32 {
        (step % self.cycle + self.cycle - self.offset % self.cycle) % self.cycle
    }
}

/// Number of steps by which a light may leave its clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Leeway {
    pub(crate) early: u32,
    pub(crate) late: u32,
}

impl Leeway {
    pub(crate) const NONE: Leeway = Leeway { early: 0, late: 0 };
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

impl ClockPlan {
    pub(super) fn fixed(timings: Vec<Timing>) -> ClockPlan {
        ClockPlan { timings, leeway: Leeway::NONE }
    }
}

/// Every episode begins with the first green; if the clock says otherwise, the light changes at once.
pub(crate) struct ClockLights {
    plan: ClockPlan,
    step: u32,
}

impl ClockLights {
    pub(crate) fn new(plan: ClockPlan) -> Self {
        ClockLights { plan, step: 0 }
    }
}

impl LightController for ClockLights {
    fn begin(&mut self, _episode: Seed) {
        self.step = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        let ClockPlan { timings, leeway } = &self.plan;
        for ((target, at), timing) in targets.iter_mut().zip(intersections.iter()).zip(timings) {
            *target = decide(&at, timing, *leeway, self.step);
        }
        self.step += 1;
    }
}

fn decide(at: &Intersection<'_>, timing: &Timing, leeway: Leeway, step: u32) -> usize {
    let Some(green) = at.green() else { return at.target() };
    let wanted = timing.target(step);
    let soon = timing.until_change(step) <= leeway.early;
    if green == wanted {
        let next = timing.after(green);
        let unused = !at.uses(green, USED_M) && at.wants(next, green, WANTED_M);
        return if soon && unused { next } else { green };
    }
    // A light that changed early is ahead of the clock, which will follow.
    if soon && green == timing.after(wanted) {
        return green;
    }
    let held = timing.since_change(step) < leeway.late && at.uses(green, HELD_M);
    if held { green } else { wanted }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::phase_plan::Shown;
    use crate::controllers::examples::{At, crossing, middle};

    const LEEWAY: Leeway = Leeway { early: 3, late: 2 };
    /// Approaches of a grid's light, and its greens.
    const WEST: usize = 0;
    const SOUTH: usize = 1;
    const VERTICAL: usize = 0;
    const HORIZONTAL: usize = 1;

    /// Decides at a light of a grid with cars at these distances before the lines. Its clock has vertical green at steps
    /// 0 to 9 and horizontal green at 13 to 22, so it changes at 10 and at 23.
    fn decided(shown: Shown, step: u32, cars: &[(usize, f64)]) -> usize {
        let plan = middle();
        let at = cars.iter().fold(At::new(&plan, shown), |at, &(side, metres)| at.cars(side, &[(metres, 9.0)]));
        decide(&at.build(), &Timing::new(&plan.phases, &[10, 10], 0), LEEWAY, step)
    }

    #[test]
    fn a_green_of_no_length_is_left_out() {
        // Four steps between two greens: green 0 at 0..5, green 2 at 9..16, green 3 at 20..23, and 0 again at 27.
        let timing = Timing::new(&crossing().phases, &[5, 0, 7, 3], 0);
        assert_eq!(timing.cycle(), 27);
        let steps = [4, 5, 15, 16, 22, 23, 26];
        assert_eq!(steps.map(|step| timing.target(step)), [0, 2, 2, 3, 3, 0, 0]);
        assert_eq!(steps.map(|step| timing.shifted(29).target(step + 2)), [0, 2, 2, 3, 3, 0, 0], "an offset of 2");
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

    #[test]
    fn an_unused_green_is_given_away_up_to_three_steps_early() {
        let vertical = Shown::Green(VERTICAL);
        let steps = [6, 7, 9].map(|step| decided(vertical, step, &[(WEST, 49.0)]));
        assert_eq!(steps, [VERTICAL, HORIZONTAL, HORIZONTAL], "a car 49 m before red");
        assert_eq!(decided(vertical, 7, &[(WEST, 50.0)]), VERTICAL, "a car further away does not want it yet");
        assert_eq!(decided(vertical, 7, &[(WEST, 0.0), (SOUTH, 39.0)]), VERTICAL, "a car within 40 m uses it");
        assert_eq!(decided(vertical, 7, &[(WEST, 0.0), (SOUTH, 40.0)]), HORIZONTAL);
        let ahead = decided(Shown::Green(HORIZONTAL), 8, &[(SOUTH, 0.0)]);
        assert_eq!(ahead, HORIZONTAL, "it went ahead and waits for the clock");
    }

    #[test]
    fn a_green_is_held_up_to_two_steps_for_a_car_that_is_almost_there() {
        let vertical = Shown::Green(VERTICAL);
        let decisions = [10, 11, 12].map(|step| decided(vertical, step, &[(SOUTH, 29.0), (WEST, 0.0)]));
        assert_eq!(decisions, [VERTICAL, VERTICAL, HORIZONTAL]);
        assert_eq!(decided(vertical, 10, &[(SOUTH, 30.0)]), HORIZONTAL, "30 m away is too far");
    }

    #[test]
    fn a_light_with_several_greens_goes_ahead_to_the_next_green_of_the_clock_only() {
        let plan = crossing();
        // Green 0 at steps 0 to 9, green 2 at 14 to 23.
        let timing = Timing::new(&plan.phases, &[10, 0, 10, 0], 0);
        let decided = |green, step, approach| {
            decide(&At::new(&plan, Shown::Green(green)).queue(approach, 1).build(), &timing, LEEWAY, step)
        };
        assert_eq!(decided(0, 8, 2), 2);
        assert_eq!(decided(0, 8, 1), 0, "the clock leaves green 1 out");
        assert_eq!(decided(3, 8, 1), 0, "neither the clock's green nor its next one");
    }
}
