//! From logits to actions and log-probabilities, in Rust and in one order of operations. So a row gives the same
//! numbers whatever the other rows are.

use rand::Rng;

use super::Action;
use crate::base::Dice;

/// How an action is chosen from its probabilities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Drawn from the policy, as in training.
    Sampled,
    Greedy,
}

impl Selection {
    /// Chooses an action. Only a draw takes a number from the dice.
    pub fn choose(self, log_probs: &[f32], dice: &mut Dice) -> Action {
        match self {
            Selection::Sampled => draw(log_probs, dice),
            Selection::Greedy => most_probable(log_probs),
        }
    }
}

/// Sets the logits of the actions that are not allowed to minus infinity, so that their probability is 0. `allowed`:
/// one per logit, or empty if all are.
pub fn forbid(logits: &mut [f32], allowed: &[bool]) {
    let forbidden = logits.iter_mut().zip(allowed).filter(|(_, allowed)| !**allowed);
    forbidden.for_each(|(logit, _)| *logit = f32::NEG_INFINITY);
}

/// Makes the best action certain: its logit becomes 0, and the others minus infinity.
pub fn make_certain(logits: &mut [f32]) {
    let best = usize::from(most_probable(logits));
    logits.iter_mut().enumerate().for_each(|(action, logit)| {
        *logit = if action == best { 0.0 } else { f32::NEG_INFINITY };
    });
}

/// Computes `-sum p ln p` of log-probabilities, without the forbidden ones.
pub fn entropy(log_probs: &[f32]) -> f32 {
    let term = |&log_prob: &f32| if log_prob == f32::NEG_INFINITY { 0.0 } else { log_prob.exp() * log_prob };
    -log_probs.iter().map(term).sum::<f32>()
}

/// Computes `ln softmax(logits)`.
pub fn log_softmax(logits: &[f32], log_probs: &mut [f32]) {
    let max = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let log_sum = logits.iter().map(|logit| (logit - max).exp()).sum::<f32>().ln() + max;
    log_probs.iter_mut().zip(logits).for_each(|(log_prob, logit)| *log_prob = logit - log_sum);
}

/// Returns the first place at which the sum of the weights exceeds a number: a draw by inversion. Rounding may leave a
/// remainder: `None`.
pub fn invert(weights: impl IntoIterator<Item = f32>, mut rest: f32) -> Option<usize> {
    weights.into_iter().position(|weight| {
        rest -= weight;
        rest < 0.0
    })
}

/// Draws from a distribution: one number from the dice, whatever the number of actions. A remainder goes to the last
/// action that is allowed.
pub fn draw(log_probs: &[f32], dice: &mut Dice) -> Action {
    let last = || log_probs.iter().rposition(|&log_prob| log_prob != f32::NEG_INFINITY);
    let drawn = invert(log_probs.iter().map(|log_prob| log_prob.exp()), dice.random());
    drawn.or_else(last).unwrap_or(log_probs.len() - 1) as Action
}

/// Returns the most probable action; if several are equally probable, the first.
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
    fn what_is_forbidden_has_no_probability_and_the_rest_share_it() {
        // softmax(ln 1, ln 2, ln 5) without the last: (1/3, 2/3); H = -(1/3 ln 1/3 + 2/3 ln 2/3) = 0.636514. Adding 100
        // to all changes nothing.
        let mut logits = [100.0, 2_f32.ln() + 100.0, 5_f32.ln() + 100.0];
        forbid(&mut logits, &[true, true, false]);
        let mut log_probs = [0.0; 3];
        log_softmax(&logits, &mut log_probs);
        assert!((log_probs[0].exp() - 1.0 / 3.0).abs() < 1e-5 && (log_probs[1].exp() - 2.0 / 3.0).abs() < 1e-5);
        assert_eq!(log_probs[2], f32::NEG_INFINITY);
        assert!((entropy(&log_probs) - 0.636_514).abs() < 1e-5);
        let mut dice = Seed::new(4).dice();
        assert!((0..10_000).all(|_| draw(&log_probs, &mut dice) < 2));
        // The largest number that dice give is below 1; these probabilities sum to less.
        let short = [0.3_f32.ln(), f32::NEG_INFINITY];
        assert!((0..100).all(|_| draw(&short, &mut dice) == 0), "the remainder goes to an action that is allowed");
        assert_eq!(most_probable(&[f32::NEG_INFINITY, -3.0, -2.0, f32::NEG_INFINITY]), 2);
        let mut untouched = [1.0, 2.0];
        forbid(&mut untouched, &[]);
        assert_eq!(untouched, [1.0, 2.0], "without a mask all are allowed");
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
