//! Division of a number of steps by shares.

/// Divides steps in proportion to `weights`, which are not negative. Every weight above 0 gets `least` steps at least,
/// and a weight of 0 gets none. Returns `None` if there are too few steps.
pub(super) fn split(steps: u32, weights: &[f64], least: u32) -> Option<Vec<u32>> {
    let shown = weights.iter().filter(|&&weight| weight > 0.0).count() as u32;
    let free = steps.checked_sub(shown * least).filter(|_| shown > 0)?;
    let sum: f64 = weights.iter().sum();
    let exact: Vec<f64> = weights.iter().map(|weight| f64::from(steps) * weight / sum).collect();
    let mut parts: Vec<u32> = weights.iter().map(|&weight| if weight > 0.0 { least } else { 0 }).collect();
    // Each step goes where most is missing.
    for _ in 0..free {
        let lack = |part: usize| exact[part] - f64::from(parts[part]);
        let shown = (0..parts.len()).filter(|&part| weights[part] > 0.0);
        let most = shown.max_by(|&one, &other| lack(one).total_cmp(&lack(other)).then(other.cmp(&one)));
        parts[most.expect("some weight is above 0")] += 1;
    }
    Some(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_sum_up_and_follow_the_weights() {
        assert_eq!(split(10, &[1.0, 1.0], 1), Some(vec![5, 5]));
        assert_eq!(split(11, &[1.0, 1.0], 1), Some(vec![6, 5]));
        assert_eq!(split(70, &[4.0, 0.0, 2.0, 1.0], 1), Some(vec![40, 0, 20, 10]));
        assert_eq!(split(10, &[1000.0, 1.0], 1), Some(vec![9, 1]), "one step at least");
        assert_eq!(split(20, &[8.0, 1.0, 1.0], 5), Some(vec![10, 5, 5]));
        assert_eq!(split(2, &[3.0, 0.0, 1.0], 1), Some(vec![1, 0, 1]));
        assert_eq!(split(9, &[3.0, 1.0], 5), None);
        assert_eq!(split(5, &[0.0], 1), None);
    }
}
