//! Lights that look at the traffic: the limits of their greens, and the rules gap-out and longest queue first.

use anyhow::Result;

use super::are_of_a_grid;
use super::arguments::Arguments;
use super::intersections::Intersection;
use crate::agents::plan::AgentPlan;

/// Steps of the longest green on nets that are no grid, as SUMO's actuated lights have. Without an end, a car that waits
/// for a gap on a lane with green may hold it for ever.
const MOST: u32 = 50;
/// Distances before the stop line within which a car uses a green of gap-out, and within which it wants another one.
const USED_M: f64 = 30.0;
const WANTED_M: f64 = 40.0;

/// Shortest and longest green, in steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct GreenLimits {
    pub(super) least: u32,
    /// After this many steps a green gives way to any other one that is wanted; `None`: never.
    pub(super) most: Option<u32>,
}

/// Returns the limits of a grid. Of 1 to 15, max-pressure does best with these on 2x2 (184, against 173 with 5 or 1). For
/// longest-queue, all values from 5 on give the same result.
impl Default for GreenLimits {
    fn default() -> Self {
        GreenLimits { least: 10, most: None }
    }
}

impl GreenLimits {
    pub(super) fn of(arguments: &mut Arguments<'_>, plans: &[AgentPlan]) -> Result<GreenLimits> {
        let least = arguments.steps("min-green")?.unwrap_or(GreenLimits::default().least);
        let limits = GreenLimits { least, ..GreenLimits::longest(arguments, plans)? };
        if let Some(most) = limits.most.filter(|&most| most < least) {
            return Err(arguments.refuse(format!("min-green = {least}: must be at most max-green, {most}")));
        }
        Ok(limits)
    }

    /// Returns the limits for the parameter `max-green`, with no shortest green.
    pub(super) fn longest(arguments: &mut Arguments<'_>, plans: &[AgentPlan]) -> Result<GreenLimits> {
        let most = arguments.steps("max-green")?.or(GreenLimits::usual(plans).most);
        Ok(GreenLimits { least: 0, most })
    }

    pub(super) fn usual(plans: &[AgentPlan]) -> GreenLimits {
        GreenLimits { most: (!are_of_a_grid(plans)).then_some(MOST), ..GreenLimits::default() }
    }

    /// Returns the green that is shown, if it has lasted long enough.
    fn may_leave(self, at: &Intersection<'_>) -> Option<usize> {
        at.green().filter(|_| at.shown_steps() >= self.least)
    }

    fn must_leave(self, at: &Intersection<'_>) -> bool {
        self.most.is_some_and(|most| at.shown_steps() >= most)
    }

    /// Returns the green with the greatest value, the first of equals. The green that is shown counts `own`, and
    /// `nothing` when the longest green is over; a tie keeps it.
    pub(super) fn greatest<T: PartialOrd>(
        self,
        at: &Intersection<'_>,
        nothing: T,
        own: impl Fn(usize) -> T,
        value: impl Fn(usize) -> T,
    ) -> usize {
        let Some(green) = self.may_leave(at) else { return at.target() };
        let (mut best, mut most) = (green, if self.must_leave(at) { nothing } else { own(green) });
        for other in at.others(green) {
            let value = value(other);
            if value > most {
                (best, most) = (other, value);
            }
        }
        best
    }
}

/// Keeps the green while a car uses it, but not beyond the longest green. Then goes to the next green that a car wants.
/// On the paper's grids it needs no more than an observation.
pub(super) fn gap_out(at: &Intersection<'_>, limits: GreenLimits) -> usize {
    let unused = |&green: &usize| limits.must_leave(at) || !at.uses(green, USED_M);
    let Some(green) = limits.may_leave(at).filter(unused) else { return at.target() };
    at.others(green).find(|&other| at.wants(other, green, WANTED_M)).unwrap_or(green)
}

/// Goes to another green if a longer queue stands on one of its approaches than on any that has green. Of several such
/// greens it takes the one with the longest queue, then the one with more standing cars.
pub(super) fn longest_queue(at: &Intersection<'_>, limits: GreenLimits) -> usize {
    limits.greatest(at, (0, usize::MAX), |green| (queues(at, green).0, usize::MAX), |green| queues(at, green))
}

/// Returns the longest queue that a green serves, and the number of all cars that stand there.
fn queues(at: &Intersection<'_>, green: usize) -> (usize, usize) {
    let queues = || at.plan().served(green).map(|approach| at.queue(approach));
    (queues().max().unwrap_or(0), queues().sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::phase_plan::Shown;
    use crate::controllers::examples::{At, crossing, middle};
    use crate::controllers::max_pressure;

    const NO_LIMITS: GreenLimits = GreenLimits { least: 0, most: None };

    #[test]
    fn greens_keep_their_limits() {
        type Rule = fn(&Intersection<'_>, GreenLimits) -> usize;
        let plan = crossing();
        let limits = GreenLimits { least: 8, most: Some(50) };
        // Cars that stand do not hold a green of max-pressure.
        for (rule, mps) in [(gap_out as Rule, 0.0), (longest_queue, 0.0), (max_pressure::decide, 5.0)] {
            let decided = |steps, using, waiting| {
                let at = At::new(&plan, Shown::Green(0)).since(steps).row(0, using, mps).queue(1, waiting);
                rule(&at.build(), limits)
            };
            assert_eq!([decided(7, 0, 1), decided(8, 0, 1)], [0, 1]);
            assert_eq!([decided(49, 9, 1), decided(50, 9, 1), decided(50, 9, 0)], [0, 1, 0]);
        }
    }

    #[test]
    fn green_is_given_away_when_nobody_uses_it_and_somebody_wants_it() {
        let plan = middle();
        let [vertical, horizontal] = [Shown::Green(0), Shown::Green(1)];
        // Cars at distances before the lines of west (0), south (1) and east (2).
        for (shown, cars, green, why) in [
            (horizontal, &[(1, 39.0)][..], 0, "a car 39 m before red"),
            (horizontal, &[(1, 40.0)], 1, "a car 40 m before red does not count yet"),
            (horizontal, &[(1, 0.0), (0, 29.0)], 1, "a car 29 m before green holds it"),
            (horizontal, &[(1, 0.0), (0, 30.0)], 0, "a car 30 m before green does not"),
            (vertical, &[(0, 0.0), (2, 0.0)], 1, "two cars before red"),
            (vertical, &[], 0, "no car"),
            (Shown::Between { from: 0, to: 1 }, &[(1, 0.0)], 1, "yellow"),
        ] {
            let at = cars.iter().fold(At::new(&plan, shown), |at, &(side, metres)| at.cars(side, &[(metres, 9.0)]));
            assert_eq!(gap_out(&at.build(), NO_LIMITS), green, "{why}");
        }
    }

    #[test]
    fn the_next_green_that_somebody_wants_is_shown() {
        let plan = crossing();
        let decided =
            |green, approach| gap_out(&At::new(&plan, Shown::Green(green)).queue(approach, 1).build(), NO_LIMITS);
        assert_eq!(decided(0, 2), 2, "nobody turns left from the west");
        assert_eq!(decided(3, 3), 0);
        assert_eq!(decided(0, 1), 1);
        assert_eq!(decided(2, 1), 3, "it comes before green 1 and lets the left turn from the west go, too");
        assert_eq!(decided(2, 2), 3, "a car that stands at a green that is not its own");
    }

    #[test]
    fn the_longest_single_queue_gets_green() {
        let plan = middle();
        let decided = |shown, queues: [usize; 4]| {
            let at =
                queues.into_iter().enumerate().fold(At::new(&plan, shown), |at, (side, cars)| at.queue(side, cars));
            longest_queue(&at.build(), GreenLimits::default())
        };
        // 3 from the west against 2 each from south and north.
        assert_eq!(decided(Shown::Green(0), [3, 2, 0, 2]), 1);
        assert_eq!(decided(Shown::Green(1), [3, 2, 0, 2]), 1);
        assert_eq!(decided(Shown::Green(0), [2, 2, 1, 0]), 0, "a tie keeps");
        assert_eq!(decided(Shown::Between { from: 0, to: 1 }, [0, 9, 0, 0]), 1);
        let moving = At::new(&plan, Shown::Green(0)).cars(0, &[(5.0, 6.0), (20.0, 6.0)]).queue(1, 1).build();
        assert_eq!(longest_queue(&moving, GreenLimits::default()), 0, "moving cars do not count");
        // Both greens 2 and 3 serve the longest queue, from the south, and green 3 the left turn from the west, too.
        let plan = crossing();
        let decided = |turning| {
            let at = At::new(&plan, Shown::Green(0)).queue(2, 4).queue(1, turning);
            longest_queue(&at.build(), GreenLimits::default())
        };
        assert_eq!([decided(1), decided(0)], [3, 2], "more cars, then the first of equals");
    }
}
