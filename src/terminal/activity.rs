//! What workers do, in words.

use crate::base::Activity;

/// What a worker is doing, in words for a person.
pub fn doing(activity: Activity) -> &'static str {
    match activity {
        Activity::Training => "training policies",
        Activity::Collection => "collecting datasets",
        Activity::AipTraining => "training AIPs",
        Activity::Evaluation => "evaluating",
    }
}
