//! Longest queue first: green for the direction with the longest queue.

use crate::domain::Action;
use crate::traffic::controllers::intersections::Intersection;
use crate::traffic::light::{KEEP, SWITCH};
use crate::traffic::side::Side;

/// Switches when more cars stand on one edge with red than on either with green.
pub fn decide(at: &Intersection<'_>, min_green: u32) -> Action {
    let Some([green, red]) = at.green_and_red().filter(|_| at.shown_steps() >= min_green) else { return KEEP };
    let longest = |sides: [Side; 2]| sides.map(|side| at.queue(side)).into_iter().max();
    if longest(red) > longest(green) { SWITCH } else { KEEP }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::agents::phases::Light;
    use crate::traffic::controllers::MIN_GREEN;
    use crate::traffic::controllers::intersections::tests::middle;

    #[test]
    fn the_longest_single_queue_gets_green() {
        let decide = |light, incoming| decide(&middle(light, MIN_GREEN, incoming, [0; 4]), MIN_GREEN);
        // 3 from the west against 2 each from south and north; moving cars do not count.
        let cars = [(3, 0), (2, 6), (0, 0), (2, 0)];
        assert_eq!(decide(Light::VerticalGreen, cars), SWITCH);
        assert_eq!(decide(Light::HorizontalGreen, cars), KEEP);
        assert_eq!(decide(Light::VerticalGreen, [(2, 0), (2, 0), (1, 0), (0, 0)]), KEEP, "a tie keeps");
        assert_eq!(decide(Light::VerticalYellow, [(9, 0), (0, 0), (0, 0), (0, 0)]), KEEP);
    }

    #[test]
    fn nobody_switches_before_the_minimum_green() {
        let decide = |shown| decide(&middle(Light::VerticalGreen, shown, [(5, 0), (0, 0), (0, 0), (0, 0)], [0; 4]), 8);
        assert_eq!([7, 8].map(decide), [KEEP, SWITCH]);
    }
}
