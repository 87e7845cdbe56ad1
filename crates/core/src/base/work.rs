//! What a long computation reports while it is under way.

use super::Stopwatch;

/// Where a long computation reports its times and its progress.
pub struct Work<'a, Progress> {
    /// Collects the time of each phase.
    pub watch: &'a mut Stopwatch,
    /// Is called from time to time with how far the computation is.
    pub progress: &'a mut dyn FnMut(Progress),
}
