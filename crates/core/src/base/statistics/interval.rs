//! Means with their 95 % intervals, over episodes.

use super::{mean, std_error, student_t};

/// A mean with the half-width of its interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    pub mean: f64,
    /// Half of the width of the 95 % confidence interval of the mean, by Student's t. The degrees of freedom are the
    /// number of values minus one. `None` for a single value, which has no spread.
    pub half_width: Option<f64>,
}

impl Interval {
    /// Computes the interval of independent `values`, at least one.
    pub fn of(values: &[f64]) -> Interval {
        let half_width = std_error(values).map(|std_error| student_t((values.len() - 1) as f64) * std_error);
        Interval { mean: mean(values), half_width }
    }

    /// Computes the interval of the differences `values - reference`, paired by episode. On the same traffic they
    /// spread less than the values.
    pub fn of_differences(values: &[f64], reference: &[f64]) -> Interval {
        assert_eq!(values.len(), reference.len(), "pairs of episodes");
        let differences: Vec<f64> = values.iter().zip(reference).map(|(value, reference)| value - reference).collect();
        Interval::of(&differences)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_half_width(interval: Interval, expected: f64) {
        let half_width = interval.half_width.unwrap();
        assert!((half_width - expected).abs() < 1e-3, "{half_width}, not {expected}");
    }

    #[test]
    fn the_half_width_is_students_t_times_the_standard_error() {
        // Mean 3, deviation sqrt((4 + 1 + 9) / 2) = 2.6458, error 1.5275; t of 2 degrees of freedom is 4.3027.
        let interval = Interval::of(&[1.0, 2.0, 6.0]);
        assert_eq!(interval.mean, 3.0);
        assert_half_width(interval, 4.3027 * 1.527_525);
        // 0 and 1 fifteen times each: deviation sqrt(30 * 0.25 / 29) = 0.50855, error 0.092848; t of 29 is 2.0452.
        let values: Vec<f64> = (0..30).map(|i| f64::from(i % 2)).collect();
        assert_half_width(Interval::of(&values), 2.0452 * 0.092_848);
    }

    #[test]
    fn one_episode_has_no_interval_and_equal_ones_an_interval_of_nothing() {
        assert_eq!(Interval::of(&[7.0]), Interval { mean: 7.0, half_width: None });
        assert_eq!(Interval::of(&[7.0, 7.0]), Interval { mean: 7.0, half_width: Some(0.0) });
    }

    #[test]
    fn differences_are_taken_episode_by_episode() {
        // The differences are all 1, although the values spread widely.
        let interval = Interval::of_differences(&[11.0, 101.0, 51.0], &[10.0, 100.0, 50.0]);
        assert_eq!(interval, Interval { mean: 1.0, half_width: Some(0.0) });
    }
}
