//! Coordinated lights: the clock of fixed-time lights, with a little leeway for the cars that are there.
//!
//! The clock lets neighbours work together: with offsets that suit the roads, cars meet green after green. The leeway
//! lets a light use what it sees. It gives an unused green away some steps early, and it holds a green some steps for
//! a car that is almost there. On the paper's grids it needs no more than an observation and the time.

use super::control::LightController;
use super::intersections::{Intersection, Intersections};
use super::timing::{ClockPlan, Leeway, Timing};
use dials_core::base::Seed;

/// Distances before the stop line within which a car uses a green, wants another one, and has a green held for it.
const USED_M: f64 = 40.0;
const WANTED_M: f64 = 50.0;
const HELD_M: f64 = 30.0;

/// Lights that follow a clock, each with the same leeway. Every episode begins with the first green.
pub(crate) struct Coordinated {
    plan: ClockPlan,
    step: u32,
}

impl Coordinated {
    pub(crate) fn new(plan: ClockPlan) -> Self {
        Coordinated { plan, step: 0 }
    }
}

impl LightController for Coordinated {
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

/// Decides for one light at a step of the clock.
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
    fn without_cars_the_clock_alone_decides() {
        let [vertical, horizontal] = [VERTICAL, HORIZONTAL].map(Shown::Green);
        let decisions = [7, 9, 10, 12].map(|step| decided(vertical, step, &[]));
        assert_eq!(decisions, [VERTICAL, VERTICAL, HORIZONTAL, HORIZONTAL]);
        let decisions = [20, 22, 23, 25].map(|step| decided(horizontal, step, &[]));
        assert_eq!(decisions, [HORIZONTAL, HORIZONTAL, VERTICAL, VERTICAL]);
        assert_eq!(decided(Shown::Between { from: VERTICAL, to: HORIZONTAL }, 23, &[]), HORIZONTAL);
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
