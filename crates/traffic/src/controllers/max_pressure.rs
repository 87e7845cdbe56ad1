//! Max-pressure: the green with the greatest pressure.
//!
//! Source: Varaiya, "Max pressure control of a network of signalized intersections", Transportation Research Part C 36,
//! 2013. The pressure of a green is the number of cars that it lets go minus the queues on the exits that it leads to.
//! A car on a lane that several links share counts for each green with the share of links that it opens. An exit that
//! leaves the net holds no car back and counts as empty, as in the paper. Cars far from the stop line do not count: with
//! all cars of long lanes, real nets jam, because cars that still drive hold a green that others wait for.
//!
//! In the paper the flow of a link weighs its cars. So a link that yields counts half in a green if another green gives
//! it priority. Else cars that wait for a gap would hold a green that hardly helps them. For the same reason a lane does
//! not count for the green that it has if its first car stands when the shortest green is over.

use std::slice::from_ref;

use super::are_of_a_grid;
use super::intersections::Intersection;
use super::responsive::GreenLimits;
use crate::agents::plan::AgentPlan;

/// Distance before the stop line within which cars count. A lane of the paper's grids has 100 m and counts whole.
const COUNTED_M: f64 = 101.0;
/// Flow of a link that yields, as a share of its flow with priority.
const YIELDING: f64 = 0.5;

/// Goes to another green if that has the greater pressure, or some pressure when the longest green is over.
pub(super) fn decide(at: &Intersection<'_>, limits: GreenLimits) -> usize {
    limits.greatest(at, 0.0, |green| pressure(at, green), |green| pressure(at, green))
}

/// Returns the pressure of a green, in cars. All approaches of the region count, also those behind other junctions.
fn pressure(at: &Intersection<'_>, green: usize) -> f64 {
    let plan = at.plan();
    let cars = |approach| at.speeds_within(approach, COUNTED_M).count() as f64;
    // Not `plan.served`: most lanes are empty in most seconds, and to see that is cheaper than to look at links.
    let has_cars = |&approach: &usize| !at.cars(approach).is_empty();
    let going = (0..plan.region.approaches.len()).filter(has_cars).filter(|&approach| plan.serves(green, approach));
    let going = going.filter(|&approach| !is_held_up(at, green, approach));
    let coming = going.map(|approach| flow(plan, green, approach) * cars(approach));
    // Cars that drive on a long exit leave room. On the short exits of the paper's grids all cars count.
    let is_grid = are_of_a_grid(from_ref(plan));
    let held = |exit: usize| if is_grid { at.exits.lane(exit).len() } else { at.exits.lane(exit).halting() };
    let leads_to =
        |exit: usize| plan.region.links.iter().enumerate().any(|(link, way)| way.to == exit && plan.opens(green, link));
    let exits = plan.region.exits.iter().enumerate().filter(|(_, lane)| !lane.leaves_the_net);
    let ahead: usize = exits.map(|(exit, _)| exit).filter(|&exit| held(exit) > 0 && leads_to(exit)).map(held).sum();
    coming.sum::<f64>() - ahead as f64
}

/// Returns how much a green lets the cars on an approach go: the mean over its links, from 0 to 1.
fn flow(plan: &AgentPlan, green: usize, approach: usize) -> f64 {
    let links = &plan.region.approaches[approach].links;
    let flow = |&link: &usize| match (plan.opens(green, link), plan.serves_best(green, link)) {
        (false, _) => 0.0,
        (true, true) => 1.0,
        (true, false) => YIELDING,
    };
    links.iter().map(flow).sum::<f64>() / links.len().max(1) as f64
}

/// Returns whether the cars on an approach stand although they have had this green for its shortest time: the first one
/// has not gone. It waits for a gap, for room on its exit, or to change lanes, so more of this green does not help.
fn is_held_up(at: &Intersection<'_>, green: usize, approach: usize) -> bool {
    let is_shown = at.green() == Some(green) && !are_of_a_grid(from_ref(at.plan()));
    is_shown && at.cars(approach).standing().last().is_some_and(|(_, stands)| stands)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::phase_plan::Shown;
    use crate::controllers::examples::{At, crossing, middle};

    #[test]
    fn the_greater_pressure_gets_green() {
        let plan = middle();
        let decided = |shown, coming: [usize; 4], gone: [usize; 4]| {
            let at =
                (0..4).fold(At::new(&plan, shown), |at, side| at.queue(side, coming[side]).exit(side, gone[side], 5.0));
            decide(&at.build(), GreenLimits::default())
        };
        let [vertical, horizontal] = [Shown::Green(0), Shown::Green(1)];
        // West and east 3 + 1 = 4, south and north 2 + 1 = 3.
        assert_eq!(decided(vertical, [3, 2, 1, 1], [0; 4]), 1);
        assert_eq!(decided(horizontal, [3, 2, 1, 1], [0; 4]), 1);
        // 1 car on the edge to the east takes 1 from the pressure of the cars from the west: 3 against 3.
        assert_eq!(decided(vertical, [3, 2, 1, 1], [0, 0, 1, 0]), 0, "a tie keeps");
        // Cars to the south and the north leave the net.
        assert_eq!(decided(horizontal, [1, 2, 1, 1], [0, 9, 0, 9]), 0);
        assert_eq!(decided(Shown::Between { from: 0, to: 1 }, [0, 9, 0, 9], [0; 4]), 1);
    }

    #[test]
    fn cars_upstream_count_and_cars_on_shared_lanes_and_cars_that_yield_count_in_part() {
        let plan = crossing();
        let pressures = |at: At<'_>| {
            let at = at.build();
            [0, 1, 2, 3].map(|green| pressure(&at, green))
        };
        let shown = || At::new(&plan, Shown::Green(1));
        assert_eq!(pressures(shown().queue(0, 2).queue(3, 1).queue(4, 3)), [6.0, 0.0, 0.0, 0.0]);
        assert_eq!(pressures(shown().queue(2, 3)), [0.0, 0.0, 1.5, 1.5]);
        // The left turn from the west has priority in green 1 and yields in green 3.
        assert_eq!(pressures(shown().row(1, 4, 5.0)), [0.0, 4.0, 0.0, 2.0]);
        // Two cars on the way north hold back greens 1, 2 and 3. Both links to the west leave the net.
        assert_eq!(pressures(shown().exit(1, 2, 0.0).exit(2, 5, 0.0)), [0.0, -2.0, -2.0, -2.0]);
        assert_eq!(pressures(shown().exit(1, 2, 5.0).exit(2, 5, 5.0)), [0.0; 4], "cars that drive hold nobody back");
        assert_eq!(decide(&shown().queue(0, 1).row(1, 2, 5.0).build(), GreenLimits::default()), 1);
        assert_eq!(decide(&shown().queue(2, 3).build(), GreenLimits::default()), 2, "the first of equals");
    }

    #[test]
    fn a_green_whose_first_car_does_not_go_gives_way() {
        let plan = crossing();
        // Five cars come from the west in green 0, which they have; one waits to turn left.
        let decided = |first_mps| {
            let coming = [(5.0, first_mps), (12.0, 0.0), (20.0, 0.0), (28.0, 0.0), (36.0, 0.0)];
            decide(&At::new(&plan, Shown::Green(0)).cars(0, &coming).queue(1, 1).build(), GreenLimits::default())
        };
        assert_eq!([decided(0.0), decided(3.0)], [1, 0]);
    }

    #[test]
    fn cars_far_away_do_not_count() {
        let mut plan = crossing();
        plan.region.approaches[0].length_m = 400.0;
        let at = At::new(&plan, Shown::Green(1)).cars(0, &[(300.0, 9.0), (250.0, 9.0), (100.0, 9.0)]).queue(1, 1);
        assert_eq!(pressure(&at.build(), 0), 1.0);
    }
}
