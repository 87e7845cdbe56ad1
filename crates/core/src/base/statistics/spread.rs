//! The spread of one figure over several seeds.

use super::{mean, std_error, student_t};

/// Smallest number of seeds for an interval. With fewer, the values of the seeds are more informative: Student's t
/// multiplies the standard error by 4.3 with three seeds and by 12.7 with two.
pub const ENOUGH_SEEDS: usize = 5;

/// Lower and upper end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub low: f64,
    pub high: f64,
}

impl Bounds {
    pub(super) fn around(centre: f64, half: f64) -> Self {
        Bounds { low: centre - half, high: centre + half }
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
    /// Student's t interval of 95 % of the mean over seeds; `None` with fewer than [`ENOUGH_SEEDS`].
    pub interval: Option<Bounds>,
}

impl Spread {
    /// Computes the spread. If there are no values: `None`.
    pub fn of(values: &[f64]) -> Option<Self> {
        (!values.is_empty()).then(|| Spread {
            values: values.to_vec(),
            mean: mean(values),
            std_error: std_error(values),
            interval: interval_of(values),
        })
    }

    /// Returns the number of seeds.
    pub fn runs(&self) -> usize {
        self.values.len()
    }
}

/// Computes Student's t interval of 95 % of the mean of one value per seed; `None` with fewer than [`ENOUGH_SEEDS`].
pub fn interval_of(values: &[f64]) -> Option<Bounds> {
    let error = std_error(values).filter(|_| values.len() >= ENOUGH_SEEDS)?;
    Some(Bounds::around(mean(values), student_t((values.len() - 1) as f64) * error))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: f64, expected: f64, within: f64) {
        assert!((found - expected).abs() < within, "{found} is not {expected}");
    }

    #[test]
    fn five_seeds_have_an_interval_of_students_t() {
        // 1 to 5: mean 3, variance 2.5, error sqrt(0.5) = 0.707107; t of 4 degrees of freedom is 2.776445.
        let spread = Spread::of(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        let interval = spread.interval.unwrap();
        assert_near(interval.low, 3.0 - 2.776_445 * 0.5_f64.sqrt(), 1e-4);
        assert_near(interval.high, 3.0 + 2.776_445 * 0.5_f64.sqrt(), 1e-4);
    }

    #[test]
    fn fewer_than_five_seeds_have_no_interval() {
        let spread = Spread::of(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert_eq!((spread.runs(), spread.mean, spread.interval), (4, 2.5, None));
        let spread = Spread::of(&[2.0]).unwrap();
        assert_eq!((spread.mean, spread.std_error, spread.interval), (2.0, None, None));
        assert_eq!(Spread::of(&[]), None);
    }
}
