//! The distribution of influence sources that the logits of an AIP stand for: sampling, cross-entropy and its gradient.

use rand::Rng;

use dials_core::base::Dice;
use dials_core::domain::sampling::invert;
use dials_core::domain::{SourceSpec, logits_of};
use stacknets::sigmoid;

/// Splits a row into the parts of the sources: as many values each as `width` returns for its number of classes.
pub(super) fn of_sources<'a>(
    spec: &'a SourceSpec,
    row: &'a [f32],
    width: impl Fn(u8) -> usize + 'a,
) -> impl Iterator<Item = &'a [f32]> {
    let mut rest = row;
    spec.classes.iter().map(move |&classes| {
        let (values, others) = rest.split_at(width(classes));
        rest = others;
        values
    })
}

/// Draws the sources of one row. `logits`: `[spec.logits()]`; `sources`: `[spec.count()]`, written.
pub(super) fn sample(spec: &SourceSpec, logits: &[f32], dice: &mut Dice, sources: &mut [u8]) {
    for (source, logits) in sources.iter_mut().zip(of_sources(spec, logits, logits_of)) {
        *source = match logits {
            &[logit] => u8::from(dice.random::<f32>() < sigmoid(logit)),
            logits => {
                let max = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                let weights = || logits.iter().map(|logit| (logit - max).exp());
                let drawn = invert(weights(), dice.random::<f32>() * weights().sum::<f32>());
                drawn.unwrap_or(logits.len() - 1) as u8
            }
        };
    }
}

/// Adds the cross-entropy of each source, in nats, to `sums`, `[spec.count()]`.
pub(super) fn add_cross_entropies(spec: &SourceSpec, logits: &[f32], observed: &[u8], sums: &mut [f64]) {
    for ((sum, logits), &u) in sums.iter_mut().zip(of_sources(spec, logits, logits_of)).zip(observed) {
        *sum += match logits {
            &[logit] => binary_cross_entropy(f64::from(logit), u),
            logits => {
                let max = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                let log_sum = logits.iter().map(|&logit| f64::from(logit - max).exp()).sum::<f64>().ln();
                log_sum - f64::from(logits[usize::from(u)] - max)
            }
        };
    }
}

/// Writes the gradient of the row's cross-entropy, added up over the sources and multiplied by `scale`.
pub(super) fn write_gradient(spec: &SourceSpec, logits: &[f32], observed: &[u8], scale: f32, gradient: &mut [f32]) {
    let mut rest = gradient;
    for (logits, &u) in of_sources(spec, logits, logits_of).zip(observed) {
        let (slopes, others) = std::mem::take(&mut rest).split_at_mut(logits.len());
        rest = others;
        match logits {
            // d/dx of -(u ln s(x) + (1 - u) ln(1 - s(x))) is s(x) - u.
            &[logit] => slopes[0] = (sigmoid(logit) - f32::from(u)) * scale,
            // d/dx_k of -ln softmax(x)_u is softmax(x)_k - [k = u].
            logits => {
                let max = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                let sum = logits.iter().map(|logit| (logit - max).exp()).sum::<f32>();
                for (class, (slope, logit)) in slopes.iter_mut().zip(logits).enumerate() {
                    let hit = if class == usize::from(u) { 1.0 } else { 0.0 };
                    *slope = ((logit - max).exp() / sum - hit) * scale;
                }
            }
        }
    }
}

/// Computes `-(u ln s(x) + (1 - u) ln(1 - s(x)))`, without overflow for any logit `x`.
fn binary_cross_entropy(logit: f64, u: u8) -> f64 {
    logit.max(0.0) - logit * f64::from(u) + (-logit.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::base::Seed;

    fn classes() -> SourceSpec {
        SourceSpec { classes: vec![3; 2], parts: 0 }
    }

    /// Returns a bit between choices of three and of four.
    fn mixed() -> SourceSpec {
        SourceSpec { classes: vec![3, 2, 4], parts: 0 }
    }

    #[test]
    fn cross_entropies_are_worked_out_by_hand() {
        // s(0) = 1/2: ln 2 either way; s(ln 3) = 3/4: -ln(3/4) = 0.28768 for 1, -ln(1/4) = 1.38629 for 0.
        assert!((binary_cross_entropy(0.0, 1) - 2_f64.ln()).abs() < 1e-12);
        assert!((binary_cross_entropy(3_f64.ln(), 1) - 0.287_682).abs() < 1e-6);
        assert!((binary_cross_entropy(3_f64.ln(), 0) - 1.386_294).abs() < 1e-6);
        assert_eq!(binary_cross_entropy(1000.0, 1), 0.0);
        assert_eq!(binary_cross_entropy(1000.0, 0), 1000.0);
        // softmax(0, ln 2, ln 5) = (1/8, 2/8, 5/8), softmax(0, 0, 1000) = (0, 0, 1)
        let mut sums = [0.0; 2];
        let logits = [0.0, 2_f32.ln(), 5_f32.ln(), 0.0, 0.0, 1000.0];
        add_cross_entropies(&classes(), &logits, &[1, 2], &mut sums);
        assert!((sums[0] - 4_f64.ln()).abs() < 1e-6 && sums[1] == 0.0, "{sums:?}");
        // A bit with s(ln 3) = 3/4 between a choice of three equal ones and one of four.
        let mut sums = [0.0; 3];
        let logits = [0.0, 0.0, 0.0, 3_f32.ln(), 0.0, 0.0, 0.0, 0.0];
        add_cross_entropies(&mixed(), &logits, &[2, 1, 3], &mut sums);
        let expected = [3_f64.ln(), -0.75_f64.ln(), 4_f64.ln()];
        assert!(sums.iter().zip(expected).all(|(sum, expected)| (sum - expected).abs() < 1e-6), "{sums:?}");
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let cases = [(SourceSpec::bits(2), vec![1, 0]), (classes(), vec![2, 0]), (mixed(), vec![1, 1, 3])];
        for (spec, observed) in &cases {
            let logits: Vec<f32> = (0..spec.logits()).map(|i| (i as f32 * 0.7).sin()).collect();
            let loss = |logits: &[f32]| {
                let mut sums = vec![0.0; spec.count()];
                add_cross_entropies(spec, logits, observed, &mut sums);
                sums.iter().sum::<f64>() * 0.25
            };
            let mut gradient = vec![0.0; logits.len()];
            write_gradient(spec, &logits, observed, 0.25, &mut gradient);
            crate::fixtures::assert_gradient(loss, &logits, &gradient, 1e-2);
        }
    }

    #[test]
    fn sources_are_drawn_as_often_as_they_are_probable() {
        let mut dice = Seed::new(9).dice();
        let mut counts = [[0_u32; 3]; 2];
        let logits = [0.0, 2_f32.ln(), 5_f32.ln(), 5_f32.ln(), 2_f32.ln(), 0.0];
        for _ in 0..80_000 {
            let mut drawn = [9; 2];
            sample(&classes(), &logits, &mut dice, &mut drawn);
            drawn.iter().zip(&mut counts).for_each(|(&class, counts)| counts[usize::from(class)] += 1);
        }
        // Standard deviations: sqrt(80000 p (1 - p)) = 94, 122, 137.
        for (counts, expected) in counts.iter().zip([[10_000, 20_000, 50_000], [50_000, 20_000, 10_000]]) {
            assert!(counts.iter().zip(expected).all(|(count, expected)| count.abs_diff(expected) < 550), "{counts:?}");
        }
        let mut ones = 0;
        for _ in 0..80_000 {
            let mut drawn = [9; 2];
            sample(&SourceSpec::bits(2), &[-(4_f32.ln()), 100.0], &mut dice, &mut drawn);
            assert_eq!(drawn[1], 1);
            ones += u32::from(drawn[0]);
        }
        // s(-ln 4) = 0.2: 16000, standard deviation 113.
        assert!(ones.abs_diff(16_000) < 460, "{ones}");
    }
}
