//! Mean, median, variance and standard error.

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

/// Computes the unbiased variance of two values or more.
pub fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_statistics_of_three_values_are_worked_out_by_hand() {
        let values = [6.0, 1.0, 2.0];
        assert_eq!((mean(&values), median(&values)), (3.0, 2.0));
        // Deviations 3, -2, -1: variance (9 + 4 + 1) / 2 = 7, standard error sqrt(7 / 3) = 1.527525.
        assert_eq!(variance(&values), 7.0);
        assert!((std_error(&values).unwrap() - 1.527_525).abs() < 1e-6);
        assert_eq!(median(&[1.0, 2.0, 4.0, 100.0]), 3.0);
    }

    #[test]
    fn a_single_value_has_no_standard_error() {
        assert_eq!(std_error(&[5.0]), None);
    }
}
