//! How far Algorithm 1 has come between two periods. With the config and the agents, it decides how training continues.

use serde::{Deserialize, Serialize};

use crate::config::{AipTraining, Config, Period};
use crate::training::drift::Drift;

/// How far training has come. The default is its beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Standing {
    /// End of the last period that is over, in timesteps per agent. Not a number of periods: the schedule may change
    /// when a run is resumed.
    pub until: u64,
    /// Timesteps per agent at the last evaluation. A schedule that has changed does not repeat it.
    pub evaluated_at: Option<u64>,
    /// Drift of the AIPs (approximate influence predictors) since their last training.
    pub drift: Drift,
}

impl Standing {
    /// Returns whether the AIPs are trained before the policies in this period.
    pub(crate) fn trains_aips(&self, period: &Period, config: &Config) -> bool {
        match period.train_aips {
            AipTraining::No => false,
            AipTraining::Yes => true,
            AipTraining::IfDrifted => self.drift.percent() > config.aip.drift_threshold,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predictors::FreshLoss;
    use crate::training::drift::Moment;

    #[test]
    fn drifted_aips_are_trained_again_where_the_schedule_leaves_it_to_the_drift() {
        let mut config = Config::default();
        config.aip.drift_threshold = 5.0;
        let trains = |standing: &Standing| {
            [AipTraining::No, AipTraining::IfDrifted, AipTraining::Yes].map(|train_aips| {
                standing.trains_aips(&Period { start: 0, end: 1, train_aips, evaluate: false, average: false }, &config)
            })
        };
        let mut standing = Standing::default();
        assert_eq!(trains(&standing), [false, false, true], "before the first training nothing can have drifted");
        let losses = |loss| [FreshLoss { predictor: vec![loss], marginals: vec![0.5] }];
        standing.drift.note(Moment::Training, &losses(0.2));
        // 0.208 / 0.2 is 4 % more, 0.212 / 0.2 is 6 %.
        standing.drift.note(Moment::Evaluation, &losses(0.208));
        assert_eq!(trains(&standing), [false, false, true]);
        standing.drift.note(Moment::Evaluation, &losses(0.212));
        assert_eq!(trains(&standing), [false, true, true]);
    }
}
