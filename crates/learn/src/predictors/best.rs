//! Early stopping: the best parameters so far, and when to give up.

/// The parameters with the lowest loss on held-out samples.
pub(super) struct BestSoFar {
    patience: usize,
    /// Lowest loss, infinite before the first one.
    loss: f64,
    values: Vec<f32>,
    /// Number of losses since then.
    since: usize,
}

impl BestSoFar {
    /// Waits for this number of losses that are not lower, at least 1.
    pub(super) fn new(patience: usize) -> BestSoFar {
        BestSoFar { patience, loss: f64::INFINITY, values: Vec::new(), since: 0 }
    }

    /// Notes the loss of some parameters. Returns whether it is time to stop.
    pub(super) fn note(&mut self, loss: f64, values: &[f32]) -> bool {
        if loss < self.loss || self.values.is_empty() {
            self.loss = loss;
            self.values.clear();
            self.values.extend_from_slice(values);
            self.since = 0;
        } else {
            self.since += 1;
        }
        self.since >= self.patience
    }

    /// Returns the best parameters.
    pub(super) fn values(&self) -> &[f32] {
        &self.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_gives_up_after_as_many_losses_as_it_is_patient_and_keeps_the_best() {
        let mut best = BestSoFar::new(2);
        let stops = [(3.0, 0.1), (2.0, 0.2), (2.5, 0.3), (1.0, 0.4), (1.0, 0.5), (f64::NAN, 0.6)]
            .map(|(loss, value)| best.note(loss, &[value]));
        assert_eq!(stops, [false, false, false, false, false, true]);
        assert_eq!(best.values(), [0.4]);
    }
}
