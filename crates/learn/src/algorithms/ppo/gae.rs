//! Generalised advantage estimation.

/// Computes generalised advantage estimates of one rollout, each row on its own.
///
/// `rewards`, `values`, `ends`: `[T, rows]`, step-major; `last_values`: `[rows]`, the value after the last step. `ends`
/// says whether the episode ended *after* that step, and cuts the sum there. If the end only cuts the recording
/// (`time_limit = "bootstrap"`), the caller has already added the discounted value of the last observation to the
/// reward. Returns the advantages `[T, rows]`; the returns are advantages + values.
///
/// Source: Schulman et al. 2016, eq. 16; gamma and lambda: DIALS paper, appendix "Hyperparameters".
pub fn advantages(
    rewards: &[f32],
    values: &[f32],
    ends: &[bool],
    last_values: &[f32],
    gamma: f32,
    lambda: f32,
) -> Vec<f32> {
    let rows = last_values.len();
    let mut advantages = vec![0.0; rewards.len()];
    let mut next_advantages = vec![0.0; rows];
    let mut next_values = last_values.to_vec();
    for t in (0..rewards.len() / rows).rev() {
        for row in 0..rows {
            let i = t * rows + row;
            let goes_on = if ends[i] { 0.0 } else { 1.0 };
            let delta = rewards[i] + gamma * next_values[row] * goes_on - values[i];
            next_advantages[row] = delta + gamma * lambda * goes_on * next_advantages[row];
            next_values[row] = values[i];
            advantages[i] = next_advantages[row];
        }
    }
    advantages
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_steps_of_two_rows_are_worked_out_by_hand() {
        // gamma = 0.5, lambda = 0.5. Row 0 never ends; row 1 ends after step 1.
        // Row 0: delta_2 = 3 + 0.5 * 8 - 2 = 5, delta_1 = 2 + 0.5 * 2 - 4 = -1, delta_0 = 1 + 0.5 * 4 - 1 = 2
        //        A_2 = 5, A_1 = -1 + 0.25 * 5 = 0.25, A_0 = 2 + 0.25 * 0.25 = 2.0625
        // Row 1: delta_2 = 1 + 0.5 * 4 - 2 = 1, delta_1 = 2 - 4 = -2 (cut), delta_0 = 0 + 0.5 * 4 - 1 = 1
        //        A_2 = 1, A_1 = -2, A_0 = 1 + 0.25 * -2 = 0.5
        let rewards = [1.0, 0.0, 2.0, 2.0, 3.0, 1.0];
        let values = [1.0, 1.0, 4.0, 4.0, 2.0, 2.0];
        let ends = [false, false, false, true, false, false];
        let advantages = advantages(&rewards, &values, &ends, &[8.0, 4.0], 0.5, 0.5);
        assert_eq!(advantages, [2.0625, 0.5, 0.25, -2.0, 5.0, 1.0]);
    }
}
