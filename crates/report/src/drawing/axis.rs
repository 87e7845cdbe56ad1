//! An axis of numbers.

use std::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;

/// Largest number on an axis. The difference of two of them is still a number.
const LARGEST: f64 = 1e300;
/// Shortest axis. Shorter ones have no room for numbers between their ends.
const SHORTEST: f64 = 1e-290;
/// Shortest axis in relation to its numbers. On a shorter one, neighbouring ticks would be the same number.
const FINEST: f64 = 1e-10;
/// How many lengths of the axis a point may lie beyond its ends. A point further away is drawn there.
const BEYOND: f64 = 8.0;
/// Largest power of ten that divides the distance of the ticks. No chart asks for a million of them.
const POWERS: i32 = 6;

const MOST_WHOLE: usize = 32;

/// A linear axis with few ticks whatever its ends are. A point beyond them is drawn near the picture.
///
/// The axis of the drawing crate never ends if its ends are huge, infinite or close to each other.
pub struct BoundedAxis {
    places: RangedCoordf64,
    start: f64,
    end: f64,
    /// Whether all ticks are at whole numbers, as on an axis of logarithms.
    whole: bool,
}

impl BoundedAxis {
    pub(crate) fn of_whole_numbers(range: Range<f64>) -> BoundedAxis {
        BoundedAxis { whole: true, ..BoundedAxis::from(range) }
    }
}

impl From<Range<f64>> for BoundedAxis {
    fn from(Range { start, end }: Range<f64>) -> Self {
        let [start, end] = [start, end].map(|value| if value.is_nan() { 0.0 } else { value.clamp(-LARGEST, LARGEST) });
        BoundedAxis { places: (start..end).into(), start, end, whole: false }
    }
}

impl Ranged for BoundedAxis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let (low, high) = (self.start.min(self.end), self.start.max(self.end));
        let beyond = BEYOND * (high - low);
        // `f64::max` and `f64::min` return the other number if one is none.
        let near = value.max(low - beyond).min(high + beyond);
        self.places.map(&near, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if self.whole {
            let numbers = self.start.ceil() as i32..=self.end.floor() as i32;
            let every = numbers.clone().count().div_ceil(MOST_WHOLE).max(1);
            return numbers.step_by(every).map(f64::from).collect();
        }
        ticks(self.start.min(self.end), self.start.max(self.end), hint.max_num_points())
    }

    fn range(&self) -> Range<f64> {
        self.start..self.end
    }
}

/// Returns at most `most` ticks from `start` to `end`: multiples of 1, 2 or 5 times a power of ten.
fn ticks(start: f64, end: f64, most: usize) -> Vec<f64> {
    let length = end - start;
    if most == 0 {
        return Vec::new();
    }
    if length < SHORTEST || length < FINEST * start.abs().max(end.abs()) {
        return vec![start];
    }
    // The first and the last multiple of a step, as numbers of steps. An end that rounding has moved counts.
    let ends = |step: f64| ((start / step - 1e-9).ceil(), (end / step + 1e-9).floor());
    let count = |(first, last): (f64, f64)| (last - first + 1.0).max(0.0);
    let mut coarse = 10_f64.powf(length.log10().floor());
    if (length / coarse).floor() + 1.0 > most as f64 {
        coarse *= 10.0;
    }
    let finer = (0..POWERS).flat_map(|power| [2.0, 5.0, 10.0].map(|part| coarse / 10_f64.powi(power) / part));
    let step = finer.take_while(|&step| count(ends(step)) <= most as f64).last().unwrap_or(coarse);
    let (first, last) = ends(step);
    let number = (count((first, last)) as usize).min(most);
    // Adding 0 turns a negative zero into a plain one.
    (0..number).map(|tick| (first + tick as f64) * step + 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plotters::coord::ranged1d::BoldPoints;

    /// Numbers that are drawn with both signs.
    const ODD: [f64; 12] = [0.0, 1.0, 0.1, 3.5, 1e15, 1e-15, 5e-324, 1e-300, 1e300, f64::MAX, f64::INFINITY, f64::NAN];

    #[test]
    fn whatever_the_ends_are_there_are_few_ticks_and_every_point_is_near_the_picture() {
        let odd = ODD.map(|number| [number, -number]).concat();
        for &start in &odd {
            for &end in &odd {
                let axis = BoundedAxis::from(start..end);
                for most in [0, 1, 7, 70] {
                    let ticks = axis.key_points(BoldPoints(most));
                    assert!(ticks.len() <= most, "{start} to {end}: {} of {most} ticks", ticks.len());
                    assert!(ticks.iter().all(|tick| tick.is_finite()), "{start} to {end}: {ticks:?}");
                }
                for value in &odd {
                    for limit in [(0, 1000), (1000, 0), (5, 5)] {
                        let place = axis.map(value, limit);
                        assert!((-9_000..10_000).contains(&place), "{value} on {start} to {end}: {place}");
                    }
                }
            }
        }
    }

    #[test]
    fn ticks_are_multiples_of_1_2_or_5_within_the_ends() {
        for (start, end, most, expected) in [
            (-0.3, 0.3, 4, "-0.2 0.0 0.2"),
            (0.0, 1.0, 11, "0.0 0.1 0.2 0.3 0.4 0.5 0.6 0.7 0.8 0.9 1.0"),
            (0.0, 1.0, 10, "0.0 0.2 0.4 0.6 0.8 1.0"),
            (137.5, 221.0, 7, "140.0 160.0 180.0 200.0 220.0"),
            (0.0, 4_060_000.0, 7, "0.0 1000000.0 2000000.0 3000000.0 4000000.0"),
            (-17.6, 1.6, 8, "-15.0 -10.0 -5.0 0.0"),
        ] {
            let ticks: Vec<String> = ticks(start, end, most).iter().map(|tick| format!("{tick:.1}")).collect();
            assert_eq!(ticks.join(" "), expected);
        }
    }
}
