//! The episodes that runs and controllers played, for the statistics of their differences.

use super::find::BaselineRecord;
use crate::base::statistics::difference::{BySeed, Difference, Played, to_controller};
use crate::records::run_record::RunRecord;

/// Returns what a run played at a step. Between two evaluations there are no episodes.
///
/// Before the first evaluation and after the last: `None`.
pub fn of_run(run: &RunRecord, steps: u64) -> Option<Played> {
    let here = run.evaluations.iter().find(|evaluation| evaluation.steps == steps);
    let returns = here.map(|evaluation| evaluation.episode_returns.clone()).unwrap_or_default();
    let count = here.and_then(|evaluation| evaluation.episodes);
    Some(Played::new(run.return_at(steps)?, count, Some(run.config.evaluation.seed), returns))
}

/// Returns the difference of a group minus a controller.
///
/// Panics if the group is empty.
pub fn minus_controller(group: &BySeed, controller: &BaselineRecord) -> Difference {
    let BaselineRecord { mean_return, episodes, seed, episode_returns, .. } = controller;
    let played = Played::new(*mean_return, Some(*episodes), *seed, episode_returns.clone());
    to_controller(group, &played, controller.std_error)
}
