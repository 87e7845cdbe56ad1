//! Quantiles of Student's t distribution.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Confidence of all intervals.
const CONFIDENCE: f64 = 0.95;

/// Returns the quantile of Student's t distribution: minus this value and this value enclose 95 %. `freedom`:
/// degrees of freedom, more than 0.
pub fn student_t(freedom: f64) -> f64 {
    let distribution = StudentsT::new(0.0, 1.0, freedom).expect("a positive number of degrees of freedom");
    distribution.inverse_cdf(1.0 - (1.0 - CONFIDENCE) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_students_t_are_those_of_the_tables() {
        for (freedom, quantile) in [(1.0, 12.706), (2.0, 4.303), (4.0, 2.776), (10.0, 2.228), (120.0, 1.980)] {
            let found = student_t(freedom);
            assert!((found - quantile).abs() < 1e-3, "{found} is not {quantile}");
        }
    }
}
