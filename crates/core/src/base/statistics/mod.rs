//! Statistics of a few values: means and their errors, intervals over episodes and over seeds.
//!
//! [`difference`] has the differences of final returns. Every interval is a 95 % confidence interval by Student's t.

use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

pub mod difference;

const CONFIDENCE: f64 = 0.95;

/// Smallest number of seeds for an interval. With fewer, the values of the seeds are more informative: Student's t
/// multiplies the standard error by 4.3 with three seeds and by 12.7 with two.
pub const ENOUGH_SEEDS: usize = 5;

/// Computes the arithmetic mean; NaN if there are no values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Computes the middle value, or the mean of the two in the middle.
///
/// Panics if there are no values.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    if sorted.len().is_multiple_of(2) { (sorted[middle - 1] + sorted[middle]) / 2.0 } else { sorted[middle] }
}

/// Computes the standard error of the mean, with the unbiased variance; `None` for a single value.
pub fn std_error(values: &[f64]) -> Option<f64> {
    let count = values.len() as f64;
    (values.len() > 1).then(|| (variance(values) / count).sqrt())
}

fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64
}

/// Returns the quantile of Student's t distribution: minus this value and this value enclose 95 %. `freedom`: degrees of
/// freedom, more than 0.
fn student_t(freedom: f64) -> f64 {
    let distribution = StudentsT::new(0.0, 1.0, freedom).expect("a positive number of degrees of freedom");
    distribution.inverse_cdf(1.0 - (1.0 - CONFIDENCE) / 2.0)
}

/// A mean over episodes with the half-width of its interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    pub mean: f64,
    /// `None` for a single value, which has no spread.
    #[serde(rename = "half_width_95")]
    pub half_width: Option<f64>,
}

impl Interval {
    /// Computes the interval of independent `values`, at least one.
    pub fn of(values: &[f64]) -> Interval {
        let half_width = std_error(values).map(|std_error| student_t((values.len() - 1) as f64) * std_error);
        Interval { mean: mean(values), half_width }
    }

    /// Computes the interval of the differences `values - reference`, paired by episode. On the same traffic they spread
    /// less than the values.
    pub fn of_differences(values: &[f64], reference: &[f64]) -> Interval {
        assert_eq!(values.len(), reference.len(), "pairs of episodes");
        let differences: Vec<f64> = values.iter().zip(reference).map(|(value, reference)| value - reference).collect();
        Interval::of(&differences)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub low: f64,
    pub high: f64,
}

impl Bounds {
    fn around(centre: f64, half: f64) -> Self {
        Bounds { low: centre - half, high: centre + half }
    }

    /// Computes the interval of the mean of one value per seed; `None` with fewer than [`ENOUGH_SEEDS`].
    fn of_seeds(values: &[f64]) -> Option<Self> {
        let Interval { mean, half_width } = Interval::of(values);
        half_width.filter(|_| values.len() >= ENOUGH_SEEDS).map(|half| Bounds::around(mean, half))
    }
}

/// One figure of the runs of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Values of the seeds, at least one.
    pub values: Vec<f64>,
    pub mean: f64,
    /// Standard error of the mean over seeds; `None` for a single seed.
    pub std_error: Option<f64>,
    /// Interval of the mean over seeds; `None` with fewer than [`ENOUGH_SEEDS`].
    pub interval: Option<Bounds>,
}

impl Spread {
    /// Computes the spread. If there are no values: `None`.
    pub fn of(values: &[f64]) -> Option<Self> {
        (!values.is_empty()).then(|| Spread {
            values: values.to_vec(),
            mean: mean(values),
            std_error: std_error(values),
            interval: Bounds::of_seeds(values),
        })
    }

    pub fn runs(&self) -> usize {
        self.values.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-3, "{found} is not {expected}");
    }

    #[test]
    fn the_statistics_of_three_values_are_worked_out_by_hand() {
        let values = [6.0, 1.0, 2.0];
        assert_eq!((mean(&values), median(&values)), (3.0, 2.0));
        // Deviations 3, -2, -1: variance (9 + 4 + 1) / 2 = 7, error sqrt(7 / 3) = 1.5275; t of 2 degrees is 4.3027.
        assert_eq!(variance(&values), 7.0);
        assert_near(std_error(&values).unwrap(), 1.527_525);
        assert_near(Interval::of(&values).half_width.unwrap(), 4.3027 * 1.527_525);
        assert_eq!(median(&[1.0, 2.0, 4.0, 100.0]), 3.0);
        assert_eq!(std_error(&[5.0]), None);
        assert_eq!(Interval::of(&[7.0]), Interval { mean: 7.0, half_width: None });
        // The differences are all 1, although the values spread widely.
        let interval = Interval::of_differences(&[11.0, 101.0, 51.0], &[10.0, 100.0, 50.0]);
        assert_eq!(interval, Interval { mean: 1.0, half_width: Some(0.0) });
    }

    #[test]
    fn quantiles_of_students_t_are_those_of_the_tables() {
        for (freedom, quantile) in [(1.0, 12.706), (2.0, 4.303), (4.0, 2.776), (10.0, 2.228), (120.0, 1.980)] {
            assert_near(student_t(freedom), quantile);
        }
    }

    #[test]
    fn only_five_seeds_and_more_have_an_interval() {
        // 1 to 5: mean 3, variance 2.5, error sqrt(0.5); t of 4 degrees of freedom is 2.776445.
        let interval = Spread::of(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap().interval.unwrap();
        assert_near(interval.low, 3.0 - 2.776_445 * 0.5_f64.sqrt());
        assert_near(interval.high, 3.0 + 2.776_445 * 0.5_f64.sqrt());
        let spread = Spread::of(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert_eq!((spread.runs(), spread.mean, spread.interval), (4, 2.5, None));
        assert_eq!(Spread::of(&[]), None);
    }
}
