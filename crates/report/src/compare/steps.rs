//! The steps at which two sides are compared. A run has figures only where it was evaluated.

use std::collections::BTreeSet;

use dials_session::records::method::steps_text;

/// How far two steps may be from each other to count as the same, as a share of the larger one. Periods are whole
/// updates of the policies, so runs with other updates are evaluated a little earlier or later.
const ALIKE: f64 = 0.01;

/// Returns the step at which each side is compared, from the steps at which all its runs were evaluated.
///
/// It is the last one that both have, up to a hundredth. If they have none after step 0: the two that are closest to
/// each other. A side without any step: `None`.
pub(crate) fn compared_at(a: &BTreeSet<u64>, b: &BTreeSet<u64>) -> Option<[u64; 2]> {
    let trained = |side: &BTreeSet<u64>| side.iter().copied().filter(|&steps| steps > 0).collect::<Vec<u64>>();
    let (of_a, of_b) = (trained(a), trained(b));
    let pairs = of_a.iter().flat_map(|&a| of_b.iter().map(move |&b| [a, b]));
    // Of equal distances, the last pair counts.
    let nearest = |pairs: &mut dyn Iterator<Item = [u64; 2]>| {
        pairs.min_by(|one, other| distance(*one).total_cmp(&distance(*other)).then(other.cmp(one)))
    };
    let last = pairs.clone().filter(|&pair| are_alike(pair)).map(|[a, _]| a).max();
    match last {
        Some(last) => nearest(&mut of_b.iter().map(|&b| [last, b])),
        None => nearest(&mut pairs.clone()).or_else(|| {
            let begin = (a.contains(&0) && b.contains(&0)).then_some([0, 0]);
            begin.or(Some([*a.last()?, *b.last()?]))
        }),
    }
}

/// Returns whether both sides are compared at the same step, up to a hundredth.
pub(crate) fn are_alike(steps: [u64; 2]) -> bool {
    distance(steps) <= ALIKE
}

/// Writes two steps, in full if they would look the same.
pub(crate) fn both_in_words([a, b]: [u64; 2]) -> [String; 2] {
    match [a, b].map(steps_text) {
        [in_a, in_b] if in_a == in_b && a != b => [a, b].map(|steps| steps.to_string()),
        words => words,
    }
}

/// Returns the distance of two steps as a share of the larger one.
fn distance([a, b]: [u64; 2]) -> f64 {
    a.abs_diff(b) as f64 / a.max(b).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_step_that_both_have_counts_or_else_the_closest_ones() {
        for (a, b, expected) in [
            (&[0, 100, 200, 300][..], &[0, 100, 200][..], Some([200, 200])),
            // 1.6 % at the end are too much.
            (&[0, 1000, 4064], &[0, 1008, 4128], Some([1000, 1008])),
            (&[0, 400_064], &[0, 400_000, 400_128], Some([400_064, 400_128])),
            (&[0], &[0, 100], Some([0, 0])),
            (&[0, 120, 240], &[0, 256], Some([240, 256])),
            // 2 to 1 and 4 to 8 are as far from each other.
            (&[200, 400], &[100, 800], Some([400, 800])),
            (&[0], &[100], Some([0, 100])),
            (&[], &[100], None),
        ] {
            let [of_a, of_b] = [a, b].map(|steps| steps.iter().copied().collect());
            assert_eq!(compared_at(&of_a, &of_b), expected, "{a:?} and {b:?}");
        }
    }
}
