//! Comparison of two groups of unequal variance.

use super::{Bounds, ENOUGH_SEEDS, mean, student_t, variance};

/// A mean and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UncertainMean {
    pub(crate) mean: f64,
    /// Variance of the mean.
    pub(crate) variance: f64,
    /// Degrees of freedom of the variance.
    pub(crate) freedom: f64,
}

impl UncertainMean {
    /// Computes the mean of one value per seed; `None` with fewer than [`ENOUGH_SEEDS`].
    pub(crate) fn of(values: &[f64]) -> Option<Self> {
        let count = values.len() as f64;
        (values.len() >= ENOUGH_SEEDS).then(|| UncertainMean {
            mean: mean(values),
            variance: variance(values) / count,
            freedom: count - 1.0,
        })
    }
}

/// Computes the 95 % interval of `b - a`, for two means of unequal variance.
///
/// Source: Welch 1947.
pub fn welch(a: UncertainMean, b: UncertainMean) -> Bounds {
    let variance = a.variance + b.variance;
    let below = a.variance.powi(2) / a.freedom + b.variance.powi(2) / b.freedom;
    // Without any variance, every number of degrees of freedom gives the same interval, of width 0.
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
        let a = UncertainMean { mean: 2.0, variance: 1.0 / 3.0, freedom: 2.0 };
        let b = UncertainMean { mean: 7.0, variance: 16.0 / 3.0, freedom: 2.0 };
        let found = welch(a, b);
        assert_near(found.high - 5.0, student_t(2.249_027) * 2.380_476, 1e-4);
        assert_near(found.high + found.low, 10.0, 1e-9);
        let sure = |mean| UncertainMean { mean, variance: 0.0, freedom: 4.0 };
        assert_eq!(welch(sure(1.0), sure(2.0)), Bounds { low: 1.0, high: 1.0 });
    }

    #[test]
    fn a_mean_over_seeds_is_uncertain_by_their_variance_and_needs_five_of_them() {
        // 1 to 5: mean 3, variance 2.5; variance of the mean 0.5.
        let mean = UncertainMean::of(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        assert_near(mean.variance, 0.5, 1e-12);
        assert_eq!((mean.mean, mean.freedom), (3.0, 4.0));
        assert_eq!(UncertainMean::of(&[1.0, 2.0, 3.0, 4.0]), None);
    }
}
