//! Drift: AIPs (approximate influence predictors) that were trained on earlier policies become outdated as policies
//! learn.
//!
//! Drift shows in their loss on new episodes of the GS (global simulator) under the current joint policy. As policies
//! learn, arrivals also become easier or harder to predict, whatever the AIPs know. So the loss is divided by the loss
//! of the best constants on the same episodes. What counts is the growth of this share since the last training. In our
//! ablation of the warehouse, the loss of AIPs that were trained once falls from 0.50 to 0.39 nats while they become
//! worse than constants.

use serde::{Deserialize, Serialize};

use crate::predictors::FreshLoss;

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

/// Loss of the AIPs on new episodes, divided by the loss of the best constants. Both are means over all agents and
/// sources. The share is 1 where no source varies: then there is nothing to know, and constants have no loss.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drift {
    /// Share right after the last training, if there was one.
    pub(crate) share_after_training: Option<f64>,
    /// Share at the last measurement.
    pub(crate) share_now: Option<f64>,
}

impl Drift {
    pub(crate) fn note(&mut self, after: Moment, losses: &[FreshLoss]) {
        let [loss, constants] = FreshLoss::means_of_all(losses);
        self.share_now = Some(if constants > 0.0 { loss / constants } else { 1.0 });
        if after == Moment::Training {
            self.share_after_training = self.share_now;
        }
    }

    /// Returns by how many percent the share has grown since the last training; NaN before the first training.
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
        assert!(drift.percent().is_nan(), "before the first training nothing can have drifted");
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

    #[test]
    fn it_shows_after_a_training_on_episodes_in_which_nothing_varied() {
        let mut drift = Drift::default();
        drift.note(Moment::Training, &losses([0.01, 0.01], 0.0));
        drift.note(Moment::Evaluation, &losses([0.75, 0.75], 0.5));
        assert!((drift.percent() - 50.0).abs() < 1e-9);
    }
}
