//! Max-pressure: green for the direction with the greater pressure.
//!
//! Source: Varaiya, "Max pressure control of a network of signalized intersections", Transportation Research Part C 36,
//! 2013. Without turns, a movement leads from one edge to one other edge. So its pressure is the number of cars that
//! come minus the number of cars on the edge ahead. An edge that leaves the net holds no car back and counts as empty,
//! as in the paper.

use crate::domain::Action;
use crate::traffic::controllers::intersections::Intersection;
use crate::traffic::light::{KEEP, SWITCH};
use crate::traffic::side::Side;

/// Switches when the directions with red have the greater pressure.
pub fn decide(at: &Intersection<'_>, min_green: u32) -> Action {
    let Some([green, red]) = at.green_and_red().filter(|_| at.shown_steps() >= min_green) else { return KEEP };
    let pressure = |sides: [Side; 2]| -> i64 { sides.into_iter().map(|from| pressure(at, from)).sum() };
    if pressure(red) > pressure(green) { SWITCH } else { KEEP }
}

fn pressure(at: &Intersection<'_>, from: Side) -> i64 {
    let to = from.opposite();
    let ahead = if at.leaves_the_net(to) { 0 } else { at.outgoing(to).len() };
    at.incoming(from).len() as i64 - ahead as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::agents::phases::Light;
    use crate::traffic::controllers::MIN_GREEN;
    use crate::traffic::controllers::intersections::tests::middle;

    #[test]
    fn the_greater_pressure_gets_green() {
        let decide = |light, incoming: [usize; 4], outgoing| {
            decide(&middle(light, MIN_GREEN, incoming.map(|cars| (0, cars)), outgoing), MIN_GREEN)
        };
        // West and east 3 + 1 = 4, south and north 2 + 1 = 3.
        assert_eq!(decide(Light::VerticalGreen, [3, 2, 1, 1], [0; 4]), SWITCH);
        assert_eq!(decide(Light::HorizontalGreen, [3, 2, 1, 1], [0; 4]), KEEP);
        // 1 car on the edge to the east takes 1 from the pressure of the cars from the west: 3 against 3.
        assert_eq!(decide(Light::VerticalGreen, [3, 2, 1, 1], [0, 0, 1, 0]), KEEP, "a tie keeps");
        // Cars to the south and the north leave the net.
        assert_eq!(decide(Light::HorizontalGreen, [1, 2, 1, 1], [0, 9, 0, 9]), SWITCH);
        assert_eq!(decide(Light::HorizontalYellow, [0, 9, 0, 9], [0; 4]), KEEP);
    }

    #[test]
    fn nobody_switches_before_the_minimum_green() {
        let decide = |shown| decide(&middle(Light::VerticalGreen, shown, [(5, 0), (0, 0), (0, 0), (0, 0)], [0; 4]), 8);
        assert_eq!([7, 8].map(decide), [KEEP, SWITCH]);
    }
}
