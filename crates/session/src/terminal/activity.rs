//! Names of the activities of workers.

use dials_core::base::Activity;

/// Returns what a worker is doing, in words.
pub(super) fn doing(activity: Activity) -> &'static str {
    match activity {
        Activity::Training => "training policies",
        Activity::Collection => "collecting datasets",
        Activity::AipTraining => "training AIPs",
        Activity::Evaluation => "evaluating",
    }
}
