//! What several seeds say together: intervals around a mean and around a difference of means.

use rand::Rng;

use crate::base::Seed;
use crate::base::statistics::{CONFIDENCE, mean, std_error, student_t, variance};

/// Resamples of a bootstrap.
const RESAMPLES: usize = 10_000;
/// The dice of every bootstrap, so that the same runs always make the same report.
const BOOTSTRAP_SEED: u64 = 1;

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

/// What the runs of a group say of one figure, one value per seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    pub runs: usize,
    pub mean: f64,
    /// Of the mean, over seeds; a single seed has none.
    pub std_error: Option<f64>,
    /// Bootstrap interval of 95 % of the mean, over seeds; a single seed has none.
    pub interval: Option<Bounds>,
}

impl Spread {
    /// None where there are no values.
    pub fn of(values: &[f64]) -> Option<Self> {
        (!values.is_empty()).then(|| Spread {
            runs: values.len(),
            mean: mean(values),
            std_error: std_error(values),
            interval: bootstrap(values),
        })
    }
}

/// The percentile bootstrap interval of the mean: the values are drawn again with replacement, and 95 % of the means
/// lie in it. Source: Efron 1979.
///
/// Too narrow for few values. With three, one resample in 27 is the lowest value three times, more than the tail of 2.5 %:
/// the interval reaches from the lowest to the highest, and misses the mean of a symmetric distribution whenever all three
/// lie on one side of it, which is once in four.
pub fn bootstrap(values: &[f64]) -> Option<Bounds> {
    if values.len() < 2 {
        return None;
    }
    let mut dice = Seed::new(BOOTSTRAP_SEED).fork("bootstrap").dice();
    let mut resample = || (0..values.len()).map(|_| values[dice.random_range(0..values.len())]).sum::<f64>();
    let mut means: Vec<f64> = (0..RESAMPLES).map(|_| resample() / values.len() as f64).collect();
    means.sort_by(f64::total_cmp);
    let tail = (1.0 - CONFIDENCE) / 2.0;
    let at = |share: f64| means[(share * (RESAMPLES - 1) as f64).round() as usize];
    Some(Bounds { low: at(tail), high: at(1.0 - tail) })
}

/// How the interval of a difference was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Of the differences seed by seed.
    Paired,
    /// Of two groups of unequal variance (Welch 1947).
    Welch,
    /// Not at all: a group has a single seed.
    SingleSeed,
}

/// How much larger the mean of one group is than that of another.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    pub mean: f64,
    pub method: Method,
    /// Student's t interval of 95 %.
    pub interval: Option<Bounds>,
}

/// `b - a`, one value per seed on either side; paired where the same seeds stand at the same places of both.
///
/// Panics where a side has no values, or where paired sides differ in length.
pub fn difference(a: &[f64], b: &[f64], paired: bool) -> Difference {
    let mean_difference = mean(b) - mean(a);
    if a.len() < 2 || b.len() < 2 {
        return Difference { mean: mean_difference, method: Method::SingleSeed, interval: None };
    }
    let (method, std_error, freedom) = if paired {
        assert_eq!(a.len(), b.len(), "pairs have two sides");
        let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| b - a).collect();
        (Method::Paired, std_error(&differences).expect("two pairs or more"), (a.len() - 1) as f64)
    } else {
        let [left, right] = [a, b].map(|side| variance(side) / side.len() as f64);
        let below = left.powi(2) / (a.len() - 1) as f64 + right.powi(2) / (b.len() - 1) as f64;
        // Without any variance every freedom gives the same interval, of no width.
        let freedom = if below > 0.0 { (left + right).powi(2) / below } else { 1.0 };
        (Method::Welch, (left + right).sqrt(), freedom)
    };
    let half = student_t(freedom) * std_error;
    Difference { mean: mean_difference, method, interval: Some(Bounds::around(mean_difference, half)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: f64, expected: f64, within: f64) {
        assert!((found - expected).abs() < within, "{found} is not {expected}");
    }

    #[test]
    fn unpaired_groups_are_compared_as_welch_does() {
        // a: mean 2, variance 1, / 3 = 1/3. b: mean 7, variance 16, / 3 = 16/3. Error sqrt(17/3) = 2.380476.
        // Freedom (17/3)^2 / ((1/9 + 256/9) / 2) = 32.1111 / 14.2778 = 2.249027; t of it is 3.8815 (R: qt(.975, 2.249027)).
        let found = difference(&[1.0, 2.0, 3.0], &[3.0, 7.0, 11.0], false);
        assert_eq!((found.mean, found.method), (5.0, Method::Welch));
        let half = found.interval.unwrap().high - 5.0;
        assert_near(half, student_t(2.249_027) * 2.380_476, 1e-4);
        assert!((9.0..9.5).contains(&half), "between the t of 2 and of 3 degrees of freedom, 4.303 and 3.182: {half}");
    }

    #[test]
    fn the_same_seeds_are_compared_pair_by_pair() {
        // Differences 2, 3, 4: mean 3, error 1 / sqrt(3) = 0.57735, times the t of 2 degrees of freedom 4.30265 = 2.48414.
        let found = difference(&[1.0, 10.0, 100.0], &[3.0, 13.0, 104.0], true);
        assert_eq!(found.method, Method::Paired);
        assert_near(found.mean, 3.0, 1e-12);
        assert_near(found.interval.unwrap().low, 3.0 - 2.484_14, 1e-4);
    }

    #[test]
    fn a_single_seed_gives_no_interval() {
        assert_eq!(
            difference(&[1.0], &[3.0, 4.0], false),
            Difference { mean: 2.5, method: Method::SingleSeed, interval: None }
        );
        let spread = Spread::of(&[2.0]).unwrap();
        assert_eq!((spread.mean, spread.std_error, spread.interval), (2.0, None, None));
        assert_eq!(Spread::of(&[]), None);
    }

    #[test]
    fn groups_without_variance_differ_for_sure() {
        let found = difference(&[1.0, 1.0], &[2.0, 2.0], false);
        assert_eq!(found.interval, Some(Bounds { low: 1.0, high: 1.0 }));
    }

    #[test]
    fn the_bootstrap_of_two_values_knows_three_means() {
        // Means 0, 1/2 and 1 with chances 1/4, 1/2, 1/4: both tails of 2.5 % lie at the ends.
        assert_eq!(bootstrap(&[0.0, 1.0]), Some(Bounds { low: 0.0, high: 1.0 }));
    }

    #[test]
    fn the_bootstrap_of_three_values_reaches_from_the_lowest_to_the_highest() {
        assert_eq!(bootstrap(&[3.0, 1.0, 2.0]), Some(Bounds { low: 1.0, high: 3.0 }));
    }

    #[test]
    fn the_bootstrap_of_many_values_is_that_of_the_normal_distribution() {
        // 0..=99: deviation of the resampled mean sqrt((100^2 - 1) / 12 / 100) = 2.8866, times 1.96 = 5.658.
        let values: Vec<f64> = (0..100).map(f64::from).collect();
        let interval = bootstrap(&values).unwrap();
        assert_near(interval.low, 49.5 - 5.658, 0.25);
        assert_near(interval.high, 49.5 + 5.658, 0.25);
        assert_eq!(bootstrap(&values), Some(interval), "its dice are always the same");
    }
}
