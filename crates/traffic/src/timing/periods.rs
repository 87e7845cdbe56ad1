//! When the demand changes so much that the lights need another plan.

use std::ops::Range;

use crate::controllers::webster::Flows;

/// Seconds of a slice in which flows are counted.
pub(super) const SLICE_S: usize = 900;
/// Shortest period, in slices. A change of plans has a price, and engineers hardly plan for less.
const SHORTEST: usize = 2;
/// Least change of the flows that is worth another plan, as a share of the flows.
const CHANGE: f64 = 0.2;

/// Divides the slices of an episode into periods of similar flows.
///
/// It begins with periods of the shortest length. Then it joins the two neighbours that differ least, until all differ
/// by more than [`CHANGE`]. What chance alone would make them differ does not count.
pub(super) fn periods(slices: &[Flows]) -> Vec<Range<usize>> {
    let count = (slices.len() / SHORTEST).max(1);
    let begin = |period: usize| if period == count { slices.len() } else { period * SHORTEST };
    let mut periods: Vec<Range<usize>> = (0..count).map(|period| begin(period)..begin(period + 1)).collect();
    while periods.len() > 1 {
        let differences = periods.windows(2).map(|pair| difference(&sum(slices, &pair[0]), &sum(slices, &pair[1])));
        let least = differences.enumerate().min_by(|(_, one), (_, other)| one.total_cmp(other));
        let (place, difference) = least.expect("there are two periods");
        if difference > CHANGE {
            break;
        }
        let joined = periods.remove(place + 1);
        periods[place].end = joined.end;
    }
    periods
}

/// Returns the flows of a period. It is not empty.
pub(super) fn sum(slices: &[Flows], period: &Range<usize>) -> Flows {
    let mut slices = slices[period.clone()].iter();
    let first = slices.next().expect("a period has a slice").clone();
    slices.fold(first, |sum, slice| sum.and(slice))
}

/// Returns how much the flows of all approaches differ, as a share of the mean flows: 0 if not more than chance would.
fn difference(one: &Flows, other: &Flows) -> f64 {
    let seconds = [one, other].map(|flows| f64::from(flows.seconds.max(1)));
    let (mut differences, mut chance, mut all) = (0.0, 0.0, 0.0);
    for (ones, others) in one.cars.iter().zip(other.cars.iter()) {
        for (&ones, &others) in ones.iter().zip(others) {
            let flows = [f64::from(ones) / seconds[0], f64::from(others) / seconds[1]];
            differences += (flows[0] - flows[1]).abs();
            all += (flows[0] + flows[1]) / 2.0;
            // Cars that come at random: the variance of a count is its mean. The mean size of a normal number is 0.8.
            let pooled = f64::from(ones + others) / (seconds[0] + seconds[1]);
            chance += (2.0 / std::f64::consts::PI).sqrt() * (pooled / seconds[0] + pooled / seconds[1]).sqrt();
        }
    }
    if all > 0.0 { ((differences - chance) / all).max(0.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::base::Ragged;

    /// Slices of two lights with two approaches each, by the cars of each approach.
    fn slices<const N: usize>(cars: [[u32; 4]; N]) -> Vec<Flows> {
        let flows = |cars: [u32; 4]| Flows { cars: Ragged::from_vec(cars.to_vec(), [2, 2]).unwrap(), seconds: 900 };
        cars.map(flows).into()
    }

    #[test]
    fn a_demand_that_does_not_change_has_one_period() {
        assert_eq!(periods(&slices([[200, 100, 150, 50]; 9])), vec![0..9]);
        // Counts of 10 differ by 3 by chance alone.
        assert_eq!(periods(&slices([[10; 4], [10; 4], [13, 8, 12, 7], [9, 12, 10, 11]])), vec![0..4]);
        assert_eq!(periods(&slices([[0; 4]; 4])), vec![0..4]);
        assert_eq!(periods(&slices([[300; 4]])), vec![0..1]);
    }

    #[test]
    fn a_rush_hour_and_a_rush_in_the_other_direction_are_periods_of_their_own() {
        let [calm, rush, back] = [[100; 4], [400, 100, 400, 100], [100, 400, 100, 400]];
        assert_eq!(periods(&slices([calm, calm, rush, rush, rush, rush, calm, calm])), [0..2, 2..6, 6..8]);
        // The lights have as many cars as before, but from elsewhere.
        assert_eq!(periods(&slices([rush, rush, back, back, back])), [0..2, 2..5]);
    }
}
