//! Drift: policies go on learning, and AIPs that were trained on what the policies of before did grow stale.
//!
//! It shows in their loss on fresh episodes of the GS under the joint policy of now, against that on the same episodes
//! right after the last training.

use serde::{Deserialize, Serialize};

use crate::influence::FreshLoss;

/// When the loss of the AIPs is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// After an evaluation of the joint policy.
    Evaluation,
    /// After a training of the AIPs.
    Training,
}

impl Moment {
    pub fn name(self) -> &'static str {
        match self {
            Moment::Evaluation => "evaluation",
            Moment::Training => "training",
        }
    }
}

/// The loss of the AIPs on fresh episodes, mean of all agents and sources, in nats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// Right after the last training, if there was one.
    after_training: Option<f64>,
    /// At the last measurement.
    now: Option<f64>,
}

impl Drift {
    pub fn note(&mut self, after: Moment, losses: &[FreshLoss]) {
        let [loss, _] = FreshLoss::means_of_all(losses);
        self.now = Some(loss);
        if after == Moment::Training {
            self.after_training = self.now;
        }
    }

    /// By how many percent the loss has grown since the last training; not a number before there was one.
    pub fn percent(&self) -> f64 {
        match (self.after_training, self.now) {
            (Some(then), Some(now)) => 100.0 * (now / then - 1.0),
            _ => f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn losses(of_agents: [f64; 2]) -> Vec<FreshLoss> {
        of_agents.map(|loss| FreshLoss { predictor: vec![loss, loss], marginals: vec![9.0, 9.0] }).to_vec()
    }

    #[test]
    fn it_is_the_growth_of_the_mean_loss_since_the_last_training() {
        let mut drift = Drift::default();
        drift.note(Moment::Evaluation, &losses([0.7, 0.7]));
        assert!(drift.percent().is_nan(), "nothing was trained yet, so nothing can have drifted");
        drift.note(Moment::Training, &losses([0.2, 0.3]));
        assert_eq!(drift.percent(), 0.0);
        drift.note(Moment::Evaluation, &losses([0.25, 0.3]));
        assert!((drift.percent() - 10.0).abs() < 1e-9, "0.275 / 0.25");
        drift.note(Moment::Evaluation, &losses([0.2, 0.25]));
        assert!((drift.percent() + 10.0).abs() < 1e-9, "it may also fall");
        drift.note(Moment::Training, &losses([0.1, 0.1]));
        assert_eq!(drift.percent(), 0.0);
    }
}
