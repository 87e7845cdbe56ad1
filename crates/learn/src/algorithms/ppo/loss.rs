//! PPO's clipped loss of a minibatch, and its gradient by the network's outputs.
//!
//! Source: Schulman et al. 2017, eq. 7 and 9. The details follow the authors' code:
//!
//! - the loss of a minibatch is `-surrogate + c1 * value loss - beta * entropy`, each a mean over the minibatch;
//! - surrogate: `min(r A, clamp(r, 1 - eps, 1 + eps) A)`, `r = pi(a|o) / pi_old(a|o)`;
//! - value loss: `max((v - R)^2, (v_old + clamp(v - v_old, -eps, eps) - R)^2)`, without a factor 1/2;
//! - advantages come as they count: normalised by a [`Spread`], or not.

use super::memory::Sample;
use dials_core::domain::sampling;

#[derive(Clone, Copy, Debug)]
pub(super) struct Weights {
    pub(crate) clip: f32,
    /// Clip range of the value.
    pub(crate) value_clip: f32,
    pub(crate) value: f32,
    pub(crate) entropy: f32,
}

/// Means over the samples of an agent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    pub(crate) surrogate: f64,
    pub(crate) value: f64,
    pub(crate) entropy: f64,
    /// Mean of `ln pi_old - ln pi`, an estimate of the KL divergence.
    pub(crate) kl: f64,
    /// Share of the samples whose ratio left the clip range.
    pub(crate) clipped: f64,
}

impl Losses {
    pub(crate) fn add(&mut self, other: &Losses, weight: f64) {
        self.surrogate += weight * other.surrogate;
        self.value += weight * other.value;
        self.entropy += weight * other.entropy;
        self.kl += weight * other.kl;
        self.clipped += weight * other.clipped;
    }
}

/// What a network puts out: all of it, or what one of its towers does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outputs {
    /// Logits, then the value.
    All,
    Logits,
    Value,
}

/// Returns the loss of one agent's minibatch, and writes its gradient with respect to the network's outputs. Policy and value
/// have nothing in common here: a part of the outputs has the same numbers alone as with the other.
///
/// `outputs`, `gradient`: `[batch, n_actions + 1]`, logits and value, or the part that `which` says; `masks`:
/// `[batch, n_actions]`, or empty if all actions are allowed.
pub(super) fn loss_and_gradient(
    (which, outputs): (Outputs, &[f32]),
    masks: &[bool],
    samples: &[Sample],
    weights: Weights,
    gradient: &mut [f32],
) -> Losses {
    let width = outputs.len() / samples.len();
    let n_actions = match which {
        Outputs::All => width - 1,
        Outputs::Logits => width,
        Outputs::Value => 0,
    };
    let batch = samples.len() as f32;
    let (mut logits, mut log_probs) = (vec![0.0; n_actions], vec![0.0; n_actions]);
    let mut masks = masks.chunks_exact(n_actions.max(1));
    let mut losses = Losses::default();
    let rows = outputs.chunks_exact(width).zip(gradient.chunks_exact_mut(width));
    for ((output, gradient), sample) in rows.zip(samples) {
        let mut of_sample = Losses::default();
        if which != Outputs::Value {
            logits.copy_from_slice(&output[..n_actions]);
            sampling::forbid(&mut logits, masks.next().unwrap_or(&[]));
            sampling::log_softmax(&logits, &mut log_probs);
            let slopes = &mut gradient[..n_actions];
            of_sample = of_policy(&log_probs, sample, weights, slopes);
            slopes.iter_mut().for_each(|slope| *slope /= batch);
        }
        if which != Outputs::Logits {
            let (loss, slope) = of_value(output[n_actions], sample, weights.value_clip);
            of_sample.value = f64::from(loss);
            gradient[n_actions] = weights.value * slope / batch;
        }
        losses.add(&of_sample, 1.0 / f64::from(batch));
    }
    losses
}

/// Returns the losses of a policy at one sample, and writes the derivatives by its logits.
fn of_policy(log_probs: &[f32], sample: &Sample, weights: Weights, slopes: &mut [f32]) -> Losses {
    let advantage = sample.advantage;
    let action = usize::from(sample.action);
    let entropy = sampling::entropy(log_probs);
    let ratio = (log_probs[action] - sample.log_prob).exp();
    let clipped = ratio.clamp(1.0 - weights.clip, 1.0 + weights.clip);
    let surrogate = (ratio * advantage).min(clipped * advantage);
    // If the clipped term is the smaller one, the surrogate does not depend on the policy.
    let policy_slope = if ratio * advantage <= clipped * advantage { ratio * advantage } else { 0.0 };
    for (logit, (slope, log_prob)) in slopes.iter_mut().zip(log_probs).enumerate() {
        let prob = log_prob.exp();
        let chosen = if logit == action { 1.0 } else { 0.0 };
        // d ln pi(a) / d logit_k = [k = a] - p_k;  d H / d logit_k = -p_k (ln p_k + H)
        let surrogate_slope = policy_slope * (chosen - prob);
        let entropy_slope = -prob * (log_prob + entropy);
        // A forbidden action has probability 0, whatever its logit, so all derivatives by that logit are 0.
        let forbidden = *log_prob == f32::NEG_INFINITY;
        *slope = if forbidden { 0.0 } else { -(surrogate_slope + weights.entropy * entropy_slope) };
    }
    Losses {
        surrogate: f64::from(surrogate),
        value: 0.0,
        entropy: f64::from(entropy),
        kl: f64::from(sample.log_prob - log_probs[action]),
        clipped: f64::from(u8::from(ratio != clipped)),
    }
}

/// Returns the loss of a value at one sample, and its derivative by the value.
fn of_value(value: f32, sample: &Sample, clip: f32) -> (f32, f32) {
    let moved = value - sample.value;
    let near = sample.value + moved.clamp(-clip, clip);
    let (error, near_error) = (value - sample.ret, near - sample.ret);
    let loss = (error * error).max(near_error * near_error);
    // The clipped term depends on the value only inside the clip range. There both terms are equal except for
    // rounding. `v_old + (v - v_old)` may miss `v` by a digit, which must not decide.
    let inside = moved.abs() <= clip;
    let slope = if inside || error * error >= near_error * near_error { 2.0 * error } else { 0.0 };
    (loss, slope)
}

/// Where some advantages lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spread {
    pub(super) mean: f32,
    pub(super) deviation: f32,
}

impl Spread {
    /// Returns their mean, and their unbiased standard deviation plus 1e-8.
    pub(super) fn of(advantages: impl Iterator<Item = f32> + Clone) -> Spread {
        let count = advantages.clone().count() as f32;
        let mean = advantages.clone().sum::<f32>() / count;
        let variance = advantages.map(|advantage| (advantage - mean).powi(2)).sum::<f32>() / (count - 1.0);
        Spread { mean, deviation: variance.sqrt() + 1e-8 }
    }

    /// Returns how many deviations an advantage is from the mean.
    pub(super) fn normalise(self, advantage: f32) -> f32 {
        (advantage - self.mean) / self.deviation
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEIGHTS: Weights = Weights { clip: 0.1, value_clip: 0.1, value: 1.0, entropy: 0.0 };

    fn sample(action: u8, old_prob: f32, value: f32, advantage: f32, ret: f32) -> Sample {
        Sample { action, log_prob: old_prob.ln(), value, advantage, ret, ..Sample::default() }
    }

    /// Returns the loss with advantages that are normalised first.
    fn loss_and_gradient(
        outputs: &[f32],
        masks: &[bool],
        samples: &[Sample],
        weights: Weights,
        gradient: &mut [f32],
    ) -> Losses {
        let spread = Spread::of(samples.iter().map(|sample| sample.advantage));
        let normalised = |sample: &Sample| Sample { advantage: spread.normalise(sample.advantage), ..*sample };
        let samples: Vec<Sample> = samples.iter().map(normalised).collect();
        super::loss_and_gradient((Outputs::All, outputs), masks, &samples, weights, gradient)
    }

    fn close(a: &[f32], b: &[f32]) -> bool {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-5)
    }

    #[test]
    fn the_loss_of_two_samples_is_worked_out_by_hand() {
        // Advantages 1 and -1 normalise to +-1 / sqrt(2) = +-0.70711 (unbiased deviation sqrt(2)).
        // Sample 1: logits (0, ln 3), action 1: p = 0.75, old 0.7: r = 1.07143, inside 1 +- 0.1.
        //   surrogate 1.07143 * 0.70711 = 0.75761; slope: 0.75761 * ([k = a] - p_k) = (-0.18940, 0.18940)
        // Sample 2: logits (0, 0), action 0: p = 0.5, old 0.4: r = 1.25, clipped 1.1; A < 0:
        //   min(-0.88388, -0.77782) = -0.88388, the unclipped term: slope -0.88388 * (0.5, -0.5) = (-0.44194, 0.44194)
        // Values: sample 1: v = 2, v_old = 2.05, R = 3: (2 - 3)^2 = 1, near = 2: 1; slope 2 * -1 = -2
        //         sample 2: v = 1, v_old = 0.5, R = 1.2: (1 - 1.2)^2 = 0.04, near = 0.6: 0.36 is larger: slope 0
        let samples = [sample(1, 0.7, 2.05, 1.0, 3.0), sample(0, 0.4, 0.5, -1.0, 1.2)];
        let outputs = [0.0, 3_f32.ln(), 2.0, 0.0, 0.0, 1.0];
        let mut gradient = [0.0; 6];
        let losses = loss_and_gradient(&outputs, &[], &samples, WEIGHTS, &mut gradient);
        assert!((losses.surrogate - (0.757_61 - 0.883_88) / 2.0).abs() < 1e-5, "{losses:?}");
        assert!((losses.value - (1.0 + 0.36) / 2.0).abs() < 1e-5, "{losses:?}");
        assert!((losses.clipped - 0.5).abs() < 1e-12);
        assert!(close(&gradient, &[0.094_70, -0.094_70, -1.0, 0.220_97, -0.220_97, 0.0]), "{gradient:?}");
    }

    #[test]
    fn a_value_inside_the_clip_range_is_pulled_however_its_sums_round() {
        // v_old = v + 0.05 (inside the range of 0.1), R = 0: slope 2 (v - 0) / 2 samples = v.
        let mut misses = 0;
        for value in (1..1000).map(|i| i as f32 * 3.7e-5) {
            let old = value + 0.05;
            misses += u32::from((old + (value - old)).powi(2) > value.powi(2));
            let mut gradient = [0.0; 6];
            let samples = [sample(0, 0.5, old, 1.0, 0.0); 2];
            loss_and_gradient(&[0.0, 0.0, value, 0.0, 0.0, value], &[], &samples, WEIGHTS, &mut gradient);
            assert_eq!(gradient[2], value);
        }
        assert!(misses > 0, "some sums round the wrong way, or this test shows nothing");
    }

    #[test]
    fn a_ratio_that_left_the_clip_range_the_good_way_pulls_no_further() {
        // Sample 1: p = 0.5, old 0.25: r = 2 > 1.1 with A > 0; sample 2: r = 0.5 < 0.9 with A < 0: both are clipped.
        let samples = [sample(0, 0.25, 0.0, 1.0, 0.0), sample(0, 1.0, 0.0, -1.0, 0.0)];
        let mut gradient = [9.0; 6];
        let losses = loss_and_gradient(&[0.0; 6], &[], &samples, WEIGHTS, &mut gradient);
        assert!(close(&gradient, &[0.0; 6]), "{gradient:?}");
        // (1.1 * 0.70711 - 0.9 * 0.70711) / 2
        assert!((losses.surrogate - 0.070_711).abs() < 1e-5);
    }

    #[test]
    fn the_gradient_agrees_with_finite_differences() {
        let weights = Weights { clip: 0.2, value_clip: 0.2, value: 0.7, entropy: 0.05 };
        let samples = [
            sample(2, 0.30, 0.4, 1.3, 0.9),
            sample(0, 0.28, -0.1, -0.4, 0.1),
            sample(1, 0.45, 0.1, 0.2, -0.6),
            sample(1, 0.20, 1.0, -2.0, 1.4),
        ];
        let outputs: Vec<f32> = (0..16).map(|i| ((i * 7 % 11) as f32 - 5.0) / 12.0).collect();
        let loss = |outputs: &[f32]| {
            let losses = loss_and_gradient(outputs, &[], &samples, weights, &mut [0.0; 16]);
            -losses.surrogate + 0.7 * losses.value - 0.05 * losses.entropy
        };
        let mut gradient = [0.0; 16];
        loss_and_gradient(&outputs, &[], &samples, weights, &mut gradient);
        crate::fixtures::assert_gradient(loss, &outputs, &gradient, 1e-3);
    }

    #[test]
    fn policy_and_value_have_the_same_numbers_apart() {
        let weights = Weights { clip: 0.2, value_clip: 0.2, value: 0.7, entropy: 0.05 };
        let samples = [sample(1, 0.3, 0.4, 1.3, 0.9), sample(0, 0.28, -0.1, -0.4, 0.1)];
        let outputs = [0.1, -0.2, 0.5, 0.3, 0.2, -0.1];
        let masks = [true, true, true, false];
        let mut together = [9.0; 6];
        let both = super::loss_and_gradient((Outputs::All, &outputs), &masks, &samples, weights, &mut together);
        let (mut of_logits, mut of_values) = ([9.0; 4], [9.0; 2]);
        let logits = [outputs[0], outputs[1], outputs[3], outputs[4]];
        let mut sum = super::loss_and_gradient((Outputs::Logits, &logits), &masks, &samples, weights, &mut of_logits);
        let values = (Outputs::Value, &[outputs[2], outputs[5]][..]);
        sum.add(&super::loss_and_gradient(values, &masks, &samples, weights, &mut of_values), 1.0);
        assert_eq!(sum, both);
        assert_eq!([of_logits[0], of_logits[1], of_values[0], of_logits[2], of_logits[3], of_values[1]], together);
    }

    #[test]
    fn an_action_that_is_masked_is_as_if_it_did_not_exist() {
        // The same two actions, once alone and once with a third between them that is masked, whatever its logit.
        let weights = Weights { clip: 0.2, value_clip: 0.2, value: 0.7, entropy: 0.05 };
        let alone = [sample(0, 0.3, 0.4, 1.3, 0.9), sample(1, 0.28, -0.1, -0.4, 0.1)];
        let masked = [alone[0], Sample { action: 2, ..alone[1] }];
        let (mut two, mut three) = ([0.0; 6], [9.0; 8]);
        let of_two = loss_and_gradient(&[0.1, -0.2, 0.5, 0.3, 0.2, -0.1], &[], &alone, weights, &mut two);
        let outputs = [0.1, 7.0, -0.2, 0.5, 0.3, -3.0, 0.2, -0.1];
        let masks = [true, false, true, true, false, true];
        let of_three = loss_and_gradient(&outputs, &masks, &masked, weights, &mut three);
        assert_eq!(of_two, of_three);
        assert_eq!([three[1], three[5]], [0.0; 2], "it is not moved");
        assert_eq!([three[0], three[2], three[3], three[4], three[6], three[7]], two);
    }

    #[test]
    fn a_critic_alone_is_not_held_back_by_the_clip() {
        // v = 0.5, v_old = 0, R = 5: with a clip of 0.1 the value has already moved too far; 2 (0.5 - 5) / 2 = -4.5.
        let samples = [sample(0, 0.5, 0.0, 1.0, 5.0); 2];
        let outputs = [0.0, 0.0, 0.5, 0.0, 0.0, 0.5];
        let mut gradient = [9.0; 6];
        loss_and_gradient(&outputs, &[], &samples, WEIGHTS, &mut gradient);
        assert_eq!(gradient[2], 0.0);
        let alone = Weights { value_clip: f32::INFINITY, ..WEIGHTS };
        loss_and_gradient(&outputs, &[], &samples, alone, &mut gradient);
        assert_eq!(gradient[2], -4.5);
    }
}
