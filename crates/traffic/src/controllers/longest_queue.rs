//! Longest queue first: green for the longest queue.

use super::green_limits::GreenLimits;
use super::intersections::Intersection;

/// Goes to another green if a longer queue stands on one of its approaches than on any that has green, or some queue when
/// the longest green is over. Of several such greens it takes the one with the longest queue, then the one with more
/// standing cars.
pub(super) fn decide(at: &Intersection<'_>, limits: GreenLimits) -> usize {
    let Some(green) = limits.may_leave(at) else { return at.target() };
    let least = if limits.must_leave(at) { 0 } else { queues(at, green).0 };
    let (mut best, mut most) = (green, (least, usize::MAX));
    for other in at.others(green) {
        let queues = queues(at, other);
        if queues > most {
            (best, most) = (other, queues);
        }
    }
    best
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

    #[test]
    fn the_longest_single_queue_gets_green() {
        let plan = middle();
        let decided = |shown, queues: [usize; 4]| {
            let at =
                queues.into_iter().enumerate().fold(At::new(&plan, shown), |at, (side, cars)| at.queue(side, cars));
            decide(&at.build(), GreenLimits::default())
        };
        // 3 from the west against 2 each from south and north.
        assert_eq!(decided(Shown::Green(0), [3, 2, 0, 2]), 1);
        assert_eq!(decided(Shown::Green(1), [3, 2, 0, 2]), 1);
        assert_eq!(decided(Shown::Green(0), [2, 2, 1, 0]), 0, "a tie keeps");
        assert_eq!(decided(Shown::Between { from: 0, to: 1 }, [0, 9, 0, 0]), 1);
        let moving = At::new(&plan, Shown::Green(0)).cars(0, &[(5.0, 6.0), (20.0, 6.0)]).queue(1, 1).build();
        assert_eq!(decide(&moving, GreenLimits::default()), 0, "moving cars do not count");
    }

    #[test]
    fn of_greens_with_the_same_longest_queue_the_one_with_more_cars_is_shown() {
        let plan = crossing();
        // Both greens 2 and 3 serve the south, green 3 the left turn from the west, too.
        let at = At::new(&plan, Shown::Green(0)).queue(2, 4).queue(1, 1);
        assert_eq!(decide(&at.build(), GreenLimits::default()), 3);
        assert_eq!(
            decide(&At::new(&plan, Shown::Green(0)).queue(2, 4).build(), GreenLimits::default()),
            2,
            "the first of equals"
        );
    }

    #[test]
    fn nobody_switches_before_the_minimum_green() {
        let plan = middle();
        let limits = GreenLimits { least: 8, most: None };
        let decided = |steps| decide(&At::new(&plan, Shown::Green(0)).since(steps).queue(0, 5).build(), limits);
        assert_eq!([7, 8].map(decided), [0, 1]);
    }

    #[test]
    fn the_longest_green_ends_if_a_queue_waits_for_another_one() {
        let plan = crossing();
        let limits = GreenLimits { least: 8, most: Some(50) };
        let decided = |steps, waiting| {
            let at = At::new(&plan, Shown::Green(0)).since(steps).queue(0, 9).queue(1, waiting);
            decide(&at.build(), limits)
        };
        assert_eq!([decided(49, 1), decided(50, 1), decided(50, 0)], [0, 1, 0]);
    }
}
