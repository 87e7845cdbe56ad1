//! Longest queue first: green for the longest queue.

use super::intersections::Intersection;

/// Goes to another green if a longer queue stands on one of its approaches than on any that has green. Of several such
/// greens it takes the one with the longest queue, then the one with more standing cars.
pub fn decide(at: &Intersection<'_>, min_green: u32) -> usize {
    let Some(green) = at.green().filter(|_| at.shown_steps() >= min_green) else { return at.target() };
    let (mut best, mut most) = (green, (queues(at, green).0, usize::MAX));
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
    use crate::traffic::agents::phase_plan::Shown;
    use crate::traffic::controllers::MIN_GREEN;
    use crate::traffic::controllers::examples::{At, crossing, middle};

    #[test]
    fn the_longest_single_queue_gets_green() {
        let plan = middle();
        let decided = |shown, queues: [usize; 4]| {
            let at =
                queues.into_iter().enumerate().fold(At::new(&plan, shown), |at, (side, cars)| at.queue(side, cars));
            decide(&at.build(), MIN_GREEN)
        };
        // 3 from the west against 2 each from south and north.
        assert_eq!(decided(Shown::Green(0), [3, 2, 0, 2]), 1);
        assert_eq!(decided(Shown::Green(1), [3, 2, 0, 2]), 1);
        assert_eq!(decided(Shown::Green(0), [2, 2, 1, 0]), 0, "a tie keeps");
        assert_eq!(decided(Shown::Between { from: 0, to: 1 }, [0, 9, 0, 0]), 1);
        let moving = At::new(&plan, Shown::Green(0)).cars(0, &[(5.0, 6.0), (20.0, 6.0)]).queue(1, 1).build();
        assert_eq!(decide(&moving, MIN_GREEN), 0, "moving cars do not count");
    }

    #[test]
    fn of_greens_with_the_same_longest_queue_the_one_with_more_cars_is_shown() {
        let plan = crossing();
        // Both greens 2 and 3 serve the south, green 3 the left turn from the west, too.
        let at = At::new(&plan, Shown::Green(0)).queue(2, 4).queue(1, 1);
        assert_eq!(decide(&at.build(), MIN_GREEN), 3);
        assert_eq!(decide(&At::new(&plan, Shown::Green(0)).queue(2, 4).build(), MIN_GREEN), 2, "the first of equals");
    }

    #[test]
    fn nobody_switches_before_the_minimum_green() {
        let plan = middle();
        let decided = |steps| decide(&At::new(&plan, Shown::Green(0)).since(steps).queue(0, 5).build(), 8);
        assert_eq!([7, 8].map(decided), [0, 1]);
    }
}
