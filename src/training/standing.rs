//! Where Algorithm 1 stands between two periods: all that decides how it goes on, besides the config and the agents.

use super::drift::Drift;
use crate::config::{AipTraining, Config, Period};

/// Where training stands. The default is its beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Standing {
    /// Number of periods of the schedule that are over.
    pub periods_done: usize,
    /// How the AIPs have drifted since their last training.
    pub drift: Drift,
}

impl Standing {
    /// Whether the AIPs are trained before the policies in this period.
    pub fn trains_aips(&self, period: &Period, config: &Config) -> bool {
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
    use crate::influence::FreshLoss;
    use crate::training::drift::Moment;

    #[test]
    fn drifted_aips_are_trained_again_where_the_schedule_leaves_it_to_the_drift() {
        let mut config = Config::default();
        config.aip.drift_threshold = 5.0;
        let trains = |standing: &Standing| {
            [AipTraining::No, AipTraining::IfDrifted, AipTraining::Yes].map(|train_aips| {
                standing.trains_aips(&Period { start: 0, end: 1, train_aips, evaluate: false }, &config)
            })
        };
        let mut standing = Standing::default();
        assert_eq!(trains(&standing), [false, false, true], "nothing was trained yet, so nothing can have drifted");
        let losses = |loss| [FreshLoss { predictor: vec![loss], marginals: vec![0.5] }];
        standing.drift.note(Moment::Training, &losses(0.2));
        // 0.208 / 0.2 is 4 % more, 0.212 / 0.2 is 6 %.
        standing.drift.note(Moment::Evaluation, &losses(0.208));
        assert_eq!(trains(&standing), [false, false, true]);
        standing.drift.note(Moment::Evaluation, &losses(0.212));
        assert_eq!(trains(&standing), [false, true, true]);
    }
}
