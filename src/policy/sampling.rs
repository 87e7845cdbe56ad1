//! From logits to actions and log-probabilities, in Rust and in one order of operations, so that a row gives the same
//! numbers in any company.

use rand::Rng;

use crate::base::Dice;
use crate::domain::Action;

/// `ln softmax(logits)`.
pub fn log_softmax(logits: &[f32], log_probs: &mut [f32]) {
    let max = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let log_sum = logits.iter().map(|logit| (logit - max).exp()).sum::<f32>().ln() + max;
    log_probs.iter_mut().zip(logits).for_each(|(log_prob, logit)| *log_prob = logit - log_sum);
}

/// Draws from a distribution by inversion: one number from the dice, whatever the number of actions.
pub fn draw(log_probs: &[f32], dice: &mut Dice) -> Action {
    let mut rest = dice.random::<f32>();
    for (action, log_prob) in log_probs.iter().enumerate() {
        rest -= log_prob.exp();
        if rest < 0.0 {
            return action as Action;
        }
    }
    (log_probs.len() - 1) as Action // rounding left a crumb
}

/// The most probable action, the first one where several are.
pub fn most_probable(log_probs: &[f32]) -> Action {
    let best =
        (1..log_probs.len()).fold(0, |best, action| if log_probs[action] > log_probs[best] { action } else { best });
    best as Action
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Seed;

    #[test]
    fn log_probabilities_of_known_logits() {
        // softmax(ln 1, ln 2, ln 5) = (1/8, 2/8, 5/8), and adding 100 to all changes nothing
        for shift in [0.0, 100.0] {
            let mut log_probs = [0.0; 3];
            log_softmax(&[shift, 2_f32.ln() + shift, 5_f32.ln() + shift], &mut log_probs);
            for (log_prob, expected) in log_probs.iter().zip([0.125_f32, 0.25, 0.625]) {
                assert!((log_prob.exp() - expected).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn actions_are_drawn_as_often_as_they_are_probable() {
        let log_probs = [0.125_f32.ln(), 0.25_f32.ln(), 0.625_f32.ln()];
        let mut dice = Seed::new(4).dice();
        let mut counts = [0; 3];
        (0..80_000).for_each(|_| counts[usize::from(draw(&log_probs, &mut dice))] += 1);
        // Standard deviations: sqrt(80000 p (1 - p)) = 94, 122, 137.
        assert!((counts[0] - 10_000_i32).abs() < 380 && (counts[1] - 20_000_i32).abs() < 490, "{counts:?}");
        assert_eq!(most_probable(&log_probs), 2);
        assert_eq!(most_probable(&[0.5, 0.5]), 0);
    }
}
