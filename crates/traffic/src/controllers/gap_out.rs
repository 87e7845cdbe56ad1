//! Gap-out: keep green as long as a car uses it.

use super::green_limits::GreenLimits;
use super::intersections::Intersection;

/// Distances before the stop line within which a car uses a green, and within which it wants another one.
const USED_M: f64 = 30.0;
const WANTED_M: f64 = 40.0;

/// Keeps the green while a car uses it, but not beyond the longest green. Then goes to the next green that a car wants.
/// On the paper's grids it needs no more than an observation.
pub(super) fn decide(at: &Intersection<'_>, limits: GreenLimits) -> usize {
    let unused = |&green: &usize| limits.must_leave(at) || !at.uses(green, USED_M);
    let Some(green) = limits.may_leave(at).filter(unused) else { return at.target() };
    at.others(green).find(|&other| at.wants(other, green, WANTED_M)).unwrap_or(green)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::phase_plan::Shown;
    use crate::controllers::examples::{At, crossing, middle};

    const NO_LIMITS: GreenLimits = GreenLimits { least: 0, most: None };

    /// Decides at a light of a grid with a car at each of these distances before the lines of west, south, east, north.
    fn decided(shown: Shown, cars: &[(usize, f64)]) -> usize {
        let plan = middle();
        let at = cars.iter().fold(At::new(&plan, shown), |at, &(side, metres)| at.cars(side, &[(metres, 9.0)]));
        decide(&at.build(), NO_LIMITS)
    }

    #[test]
    fn green_is_given_away_when_nobody_uses_it_and_somebody_wants_it() {
        let [vertical, horizontal] = [Shown::Green(0), Shown::Green(1)];
        assert_eq!(decided(horizontal, &[(1, 39.0)]), 0, "a car 39 m before red");
        assert_eq!(decided(horizontal, &[(1, 40.0)]), 1, "a car 40 m before red does not count yet");
        assert_eq!(decided(horizontal, &[(1, 0.0), (0, 29.0)]), 1, "a car 29 m before green holds it");
        assert_eq!(decided(horizontal, &[(1, 0.0), (0, 30.0)]), 0, "a car 30 m before green does not");
        assert_eq!(decided(vertical, &[(0, 0.0), (2, 0.0)]), 1);
        assert_eq!(decided(vertical, &[]), 0);
        assert_eq!(decided(Shown::Between { from: 0, to: 1 }, &[(1, 0.0)]), 1);
    }

    #[test]
    fn the_next_green_that_somebody_wants_is_shown() {
        let plan = crossing();
        let decided =
            |green, approach| decide(&At::new(&plan, Shown::Green(green)).queue(approach, 1).build(), NO_LIMITS);
        assert_eq!(decided(0, 2), 2, "nobody turns left from the west");
        assert_eq!(decided(3, 3), 0);
        assert_eq!(decided(0, 1), 1);
        assert_eq!(decided(2, 1), 3, "it comes before green 1 and lets the left turn from the west go, too");
        assert_eq!(decided(2, 2), 3, "a car that stands at a green that is not its own");
    }

    #[test]
    fn a_green_in_use_ends_after_the_longest_green() {
        let plan = crossing();
        let limits = GreenLimits { least: 0, most: Some(50) };
        let decided = |steps, waiting| {
            let at = At::new(&plan, Shown::Green(0)).since(steps).queue(0, 9).queue(1, waiting);
            decide(&at.build(), limits)
        };
        assert_eq!([decided(49, 1), decided(50, 1), decided(50, 0)], [0, 1, 0]);
    }
}
