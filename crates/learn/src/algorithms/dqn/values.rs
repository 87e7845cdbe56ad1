//! From the outputs of a network to the values of the actions, and the loss of a minibatch.

/// Computes the values of the actions from the outputs of a network, `[n_actions + 1]`: advantages and the value of the
/// state if it is `dueling`, else the values themselves.
///
/// Source: Wang et al. 2016, eq. 9. The mean of the advantages is over all actions, allowed or not.
pub(super) fn action_values(outputs: &[f32], dueling: bool, values: &mut [f32]) {
    let (advantages, state) = outputs.split_at(outputs.len() - 1);
    values.copy_from_slice(advantages);
    if dueling {
        let mean = advantages.iter().sum::<f32>() / advantages.len() as f32;
        values.iter_mut().for_each(|value| *value += state[0] - mean);
    }
}

/// Returns the best of the actions that are allowed; the first of several. `mask`: 0 where an action is not allowed;
/// empty if all are.
pub(super) fn best_action(values: &[f32], mask: &[f32]) -> usize {
    let allowed = (0..values.len()).filter(|&action| mask.get(action) != Some(&0.0));
    allowed.reduce(|best, action| if values[action] > values[best] { action } else { best }).unwrap_or(0)
}

/// Adds the gradient of `slope` times the value of an action by the outputs of a network to `gradient`, `[n_actions + 1]`.
pub(super) fn add_gradient(slope: f32, action: usize, dueling: bool, gradient: &mut [f32]) {
    gradient[action] += slope;
    if dueling {
        let n_actions = gradient.len() - 1;
        let share = slope / n_actions as f32;
        gradient[..n_actions].iter_mut().for_each(|value| *value -= share);
        gradient[n_actions] += slope;
    }
}

/// Returns the Huber loss of an error, and its slope.
pub(super) fn huber(error: f32) -> (f32, f32) {
    if error.abs() <= 1.0 { (0.5 * error * error, error) } else { (error.abs() - 0.5, error.signum()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dueling_values_are_the_state_plus_the_advantage_over_the_mean() {
        let mut values = [0.0; 3];
        // Advantages 1, 2, 6 with mean 3, state 10.
        action_values(&[1.0, 2.0, 6.0, 10.0], true, &mut values);
        assert_eq!(values, [8.0, 9.0, 13.0]);
        action_values(&[1.0, 2.0, 6.0, 10.0], false, &mut values);
        assert_eq!(values, [1.0, 2.0, 6.0]);
        assert_eq!((best_action(&values, &[1.0, 1.0, 0.0]), best_action(&values, &[])), (1, 2));
    }

    #[test]
    fn the_gradient_agrees_with_finite_differences() {
        for dueling in [false, true] {
            let value = |outputs: &[f32]| {
                let mut values = [0.0; 3];
                action_values(outputs, dueling, &mut values);
                f64::from(2.0 * values[1])
            };
            let mut gradient = [0.0; 4];
            add_gradient(2.0, 1, dueling, &mut gradient);
            crate::fixtures::assert_gradient(value, &[0.3, -0.2, 0.7, 0.1], &gradient, 1e-2);
        }
    }

    #[test]
    fn large_errors_pull_no_harder_than_an_error_of_one() {
        assert_eq!([huber(0.5), huber(-3.0)], [(0.125, 0.5), (2.5, -1.0)]);
    }
}
