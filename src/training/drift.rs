//! Drift: policies go on learning, and AIPs that were trained on what the policies of before did grow stale.
//!
//! It shows in their loss on fresh episodes of the GS under the joint policy of now. Arrivals become easier or harder to
//! predict as policies learn, whatever AIPs know of them, so the loss counts as a share of that of the best constants on the same
//! episodes, and its growth since right after the last training. In our ablation of the warehouse the loss of AIPs
//! that were trained once falls from 0.50 to 0.39 nats while they get worse than constants.

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

/// The loss of the AIPs on fresh episodes as a share of that of the best constants, both the mean of all agents and sources.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// Right after the last training, if there was one.
    share_after_training: Option<f64>,
    /// At the last measurement.
    share_now: Option<f64>,
}

impl Drift {
    pub fn note(&mut self, after: Moment, losses: &[FreshLoss]) {
        let [loss, constants] = FreshLoss::means_of_all(losses);
        self.share_now = Some(loss / constants);
        if after == Moment::Training {
            self.share_after_training = self.share_now;
        }
    }

    /// By how many percent that share has grown since the last training; not a number before there was one.
    pub fn percent(&self) -> f64 {
        match (self.share_after_training, self.share_now) {
            (Some(then), Some(now)) => 100.0 * (now / then - 1.0),
            _ => f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn losses(of_agents: [f64; 2], constants: f64) -> Vec<FreshLoss> {
        let of_agent = |loss| FreshLoss { predictor: vec![loss, loss], marginals: vec![constants, constants] };
        of_agents.map(of_agent).to_vec()
    }

    #[test]
    fn it_is_the_growth_of_the_mean_loss_beside_that_of_constants_since_the_last_training() {
        let mut drift = Drift::default();
        drift.note(Moment::Evaluation, &losses([0.7, 0.7], 0.5));
        assert!(drift.percent().is_nan(), "nothing was trained yet, so nothing can have drifted");
        drift.note(Moment::Training, &losses([0.2, 0.3], 0.5));
        assert_eq!(drift.percent(), 0.0);
        drift.note(Moment::Evaluation, &losses([0.25, 0.3], 0.5));
        assert!((drift.percent() - 10.0).abs() < 1e-9, "0.275 / 0.25");
        drift.note(Moment::Evaluation, &losses([0.2, 0.25], 0.4));
        assert!((drift.percent() - 12.5).abs() < 1e-9, "0.225 / 0.4 against 0.25 / 0.5");
        drift.note(Moment::Evaluation, &losses([0.2, 0.25], 0.5));
        assert!((drift.percent() + 10.0).abs() < 1e-9, "it may also fall");
        drift.note(Moment::Training, &losses([0.1, 0.1], 0.5));
        assert_eq!(drift.percent(), 0.0);
    }
}
