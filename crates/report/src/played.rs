//! The episodes that runs and controllers played, for the statistics of their differences.

use dials_core::base::statistics::difference::{BySeed, Difference, Played, to_controller};
use dials_session::records::find::BaselineRecord;
use dials_session::records::run_record::{EvaluationRecord, RunRecord};

/// Returns what runs played at their evaluations at a step, by seed.
pub(crate) fn of_runs(runs: &[&RunRecord], steps: u64) -> BySeed {
    let played = runs.iter().filter_map(|run| {
        let EvaluationRecord { all, episode_returns, .. } = run.evaluation_at(steps)?;
        let played = Played::new(all.mean, run.config.learning.evaluation.seed, episode_returns.clone());
        Some((run.config.learning.seed, played))
    });
    played.collect()
}

/// Returns what a controller played.
pub(crate) fn of_controller(controller: &BaselineRecord) -> Played {
    Played::new(controller.mean_return, controller.seed, controller.episode_returns.clone())
}

/// Returns the difference of a group minus a controller.
///
/// Panics if the group is empty.
pub(crate) fn minus_controller(group: &BySeed, controller: &BaselineRecord) -> Difference {
    to_controller(group, &of_controller(controller))
}
