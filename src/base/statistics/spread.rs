//! What several seeds say together: Student's t intervals around a mean and around a difference of means.

use crate::base::statistics::{mean, std_error, student_t, variance};

/// Number of seeds from which on an interval is given. With fewer the seeds themselves say more: Student's t multiplies the
/// standard error by 4.3 with three seeds and by 12.7 with two.
pub const ENOUGH_SEEDS: usize = 5;

/// Lower and upper end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub low: f64,
    pub high: f64,
}

impl Bounds {
    fn around(centre: f64, half: f64) -> Self {
        Bounds { low: centre - half, high: centre + half }
    }
}

/// What the runs of a group say of one figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Values of the seeds, at least one.
    pub values: Vec<f64>,
    pub mean: f64,
    /// Standard error of the mean over seeds; a single seed has none.
    pub std_error: Option<f64>,
    /// Student's t interval of 95 % of the mean over seeds; `None` with fewer than [`ENOUGH_SEEDS`].
    pub interval: Option<Bounds>,
}

impl Spread {
    /// `None` if there are no values.
    pub fn of(values: &[f64]) -> Option<Self> {
        (!values.is_empty()).then(|| Spread {
            values: values.to_vec(),
            mean: mean(values),
            std_error: std_error(values),
            interval: interval_of(values),
        })
    }

    /// Number of seeds.
    pub fn runs(&self) -> usize {
        self.values.len()
    }
}

/// Student's t interval of 95 % of the mean of one value per seed; `None` with fewer than [`ENOUGH_SEEDS`].
pub fn interval_of(values: &[f64]) -> Option<Bounds> {
    let error = std_error(values).filter(|_| values.len() >= ENOUGH_SEEDS)?;
    Some(Bounds::around(mean(values), student_t((values.len() - 1) as f64) * error))
}

/// A mean, and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    pub mean: f64,
    /// Variance of the mean.
    pub variance: f64,
    /// Degrees of freedom of the variance.
    pub freedom: f64,
}

impl Estimate {
    /// The mean of one value per seed; `None` with fewer than [`ENOUGH_SEEDS`].
    pub fn of(values: &[f64]) -> Option<Self> {
        let count = values.len() as f64;
        (values.len() >= ENOUGH_SEEDS).then(|| Estimate {
            mean: mean(values),
            variance: variance(values) / count,
            freedom: count - 1.0,
        })
    }
}

/// The 95 % interval of `b - a`, of two means of unequal variance.
///
/// Source: Welch 1947.
pub fn welch(a: Estimate, b: Estimate) -> Bounds {
    let variance = a.variance + b.variance;
    let below = a.variance.powi(2) / a.freedom + b.variance.powi(2) / b.freedom;
    // Without any variance every freedom gives the same interval, of no width.
    let freedom = if below > 0.0 { variance.powi(2) / below } else { 1.0 };
    Bounds::around(b.mean - a.mean, student_t(freedom) * variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: f64, expected: f64, within: f64) {
        assert!((found - expected).abs() < within, "{found} is not {expected}");
    }

    #[test]
    fn unequal_groups_are_compared_as_welch_does() {
        // a: mean 2, variance 1, / 3 = 1/3. b: mean 7, variance 16, / 3 = 16/3. Error sqrt(17/3) = 2.380476.
        // Freedom (17/3)^2 / ((1/9 + 256/9) / 2) = 32.1111 / 14.2778 = 2.249027.
        let a = Estimate { mean: 2.0, variance: 1.0 / 3.0, freedom: 2.0 };
        let b = Estimate { mean: 7.0, variance: 16.0 / 3.0, freedom: 2.0 };
        let found = welch(a, b);
        assert_near(found.high - 5.0, student_t(2.249_027) * 2.380_476, 1e-4);
        assert_near(found.high + found.low, 10.0, 1e-9);
        let sure = |mean| Estimate { mean, variance: 0.0, freedom: 4.0 };
        assert_eq!(welch(sure(1.0), sure(2.0)), Bounds { low: 1.0, high: 1.0 });
    }

    #[test]
    fn five_seeds_have_an_interval_of_students_t() {
        // 1 to 5: mean 3, variance 2.5, error sqrt(0.5) = 0.707107; t of 4 degrees of freedom is 2.776445.
        let spread = Spread::of(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        let interval = spread.interval.unwrap();
        assert_near(interval.low, 3.0 - 2.776_445 * 0.5_f64.sqrt(), 1e-4);
        assert_near(interval.high, 3.0 + 2.776_445 * 0.5_f64.sqrt(), 1e-4);
        let estimate = Estimate::of(&spread.values).unwrap();
        assert_near(estimate.variance, 0.5, 1e-12);
        assert_eq!((estimate.mean, estimate.freedom), (3.0, 4.0));
    }

    #[test]
    fn fewer_than_five_seeds_have_no_interval() {
        let spread = Spread::of(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert_eq!((spread.runs(), spread.mean, spread.interval), (4, 2.5, None));
        assert_eq!(Estimate::of(&spread.values), None);
        let spread = Spread::of(&[2.0]).unwrap();
        assert_eq!((spread.mean, spread.std_error, spread.interval), (2.0, None, None));
        assert_eq!(Spread::of(&[]), None);
    }
}
