//! How far Algorithm 1 has come between two periods, or within one. With the config and the agents, it decides how training continues.

use serde::{Deserialize, Serialize};

use crate::config::{AipTraining, Config, Period, schedule};
use crate::predictors::FreshLoss;
use crate::state::AgentsState;
use crate::steps::train_policies::PolicyTraining;
use anyhow::ensure;
use dials_core::domain::Result;

/// Longest wall time of a run that is believed, in seconds: three hundred years.
const LONGEST_S: f64 = 1e10;

/// How far training has come. The default is its beginning.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingProgress {
    /// End of the last period that is over, or of the part of a period, in timesteps per agent. Not a number of periods: the
    /// schedule may change when a run is resumed.
    pub until: u64,
    /// What a period that is not over has brought.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub so_far: Option<PolicyTraining>,
    /// Timesteps per agent at the last training of the AIPs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aips_trained_at: Option<u64>,
    /// Timesteps per agent at the last evaluation. A schedule that has changed does not repeat it.
    pub evaluated_at: Option<u64>,
    pub drift: Drift,
}

impl TrainingProgress {
    /// Returns an error that says how it contradicts the config that it was reached with, or the state.
    pub fn check(&self, state: &AgentsState, elapsed_s: f64, config: &Config) -> Result<()> {
        let TrainingProgress { until, ref so_far, aips_trained_at, evaluated_at, drift } = *self;
        if let Some(so_far) = so_far {
            so_far.check(state.agents())?;
            ensure!(so_far.updates > 0, "it has come into a period by no update");
            ensure!(
                config.update_at_or_before(until) == until,
                "it is within a period at step {until}, but not at an update"
            );
        } else {
            let ends_there = until == 0 || self.ends_a_period(config);
            ensure!(ends_there, "it ends a period at step {until}, where its own schedule has none");
        }
        ensure!(
            aips_trained_at.is_none_or(|at| at <= state.steps),
            "its last training of AIPs is at step {}, after its own step {}",
            aips_trained_at.unwrap_or(0),
            state.steps
        );
        let steps = config.update_at_or_after(until);
        ensure!(
            state.steps == steps,
            "its period ends at step {until}, so training is at step {steps}, but it is at step {}",
            state.steps
        );
        ensure!(
            evaluated_at.is_none_or(|at| at <= state.steps),
            "its last evaluation is at step {}, after its own step {}",
            evaluated_at.unwrap_or(0),
            state.steps
        );
        ensure!((0.0..=LONGEST_S).contains(&elapsed_s), "it was written after {elapsed_s} seconds, which cannot be");
        let shares = [drift.share_after_training, drift.share_now];
        ensure!(
            shares.into_iter().flatten().all(|share| share >= 0.0 && share.is_finite()),
            "its drift is {drift:?}, but a loss is a positive number"
        );
        ensure!(
            drift.share_after_training.is_none() || config.trains_predictors(),
            "its drift counts from a training of influence predictors, and this run trains none"
        );
        Ok(())
    }

    /// Returns whether a period of the config's schedule ends where training has come to.
    pub(crate) fn ends_a_period(&self, config: &Config) -> bool {
        schedule(config).iter().any(|period| period.end == self.until)
    }

    /// Returns whether the AIPs are trained before the policies in this period, and were not yet. `steps`: timesteps per agent now.
    pub(crate) fn trains_aips(&self, period: &Period, steps: u64, config: &Config) -> bool {
        if self.aips_trained_at == Some(steps) {
            return false;
        }
        match period.train_aips {
            AipTraining::No => false,
            AipTraining::Yes => true,
            AipTraining::IfDrifted => self.drift.percent() > config.aip.drift_threshold,
        }
    }
}

/// When the loss of the AIPs is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    Evaluation,
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

/// How much AIPs that were trained on earlier policies have become outdated: their loss on new episodes of the GS under
/// the current joint policy, divided by the loss of the best constants on the same episodes. What counts is the growth
/// of this share since the last training. The loss alone would not show it: in our ablation of the warehouse, that of
/// AIPs that were trained once falls from 0.50 to 0.39 nats while they become worse than constants.
///
/// Both losses are means over all agents and sources. Where no source varies, constants have no loss and the share is 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drift {
    /// Share right after the last training, if there was one.
    share_after_training: Option<f64>,
    /// Share at the last measurement.
    share_now: Option<f64>,
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

    #[test]
    fn it_is_the_growth_of_the_mean_loss_beside_that_of_constants_since_the_last_training() {
        let losses = |of_agents: [f64; 2], constants| {
            of_agents.map(|loss| FreshLoss { predictor: vec![loss; 2], marginals: vec![constants; 2] })
        };
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
        // After a training on episodes in which nothing varied.
        drift.note(Moment::Training, &losses([0.01, 0.01], 0.0));
        assert_eq!(drift.percent(), 0.0);
        drift.note(Moment::Evaluation, &losses([0.75, 0.75], 0.5));
        assert!((drift.percent() - 50.0).abs() < 1e-9);
    }
}
