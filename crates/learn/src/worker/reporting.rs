//! A controller that reports at every decision which share of its episodes is played.
//!
//! Some episodes take longer than the coordinator waits for a word of its workers: a whole day of a large map. A worker
//! that spoke only between episodes would look as if it hung.

use crate::observer::Observer;
use dials_core::base::{Activity, Seed};
use dials_core::domain::{Action, Controller, JointPercept, Result};

/// A controller that reports its progress to an observer.
pub(crate) struct Reporting<'a> {
    inner: &'a mut dyn Controller,
    observer: &'a dyn Observer,
    activity: Activity,
    /// Number of decisions so far, and in all episodes.
    decided: usize,
    all: usize,
}

impl<'a> Reporting<'a> {
    /// `decisions`: the number of decisions in all episodes that will be played.
    pub(crate) fn new(
        inner: &'a mut dyn Controller,
        observer: &'a dyn Observer,
        activity: Activity,
        decisions: usize,
    ) -> Reporting<'a> {
        Reporting { inner, observer, activity, decided: 0, all: decisions }
    }
}

impl Controller for Reporting<'_> {
    fn decides(&self) -> bool {
        self.inner.decides()
    }

    fn begin(&mut self, episode: Seed) {
        self.inner.begin(episode);
    }

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        self.decided += 1;
        self.observer.busy(self.activity, self.decided as f64 / self.all as f64);
        self.inner.act(percept, actions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::play;
    use dials_core::domain::Domain;
    use dials_testkit::toy::Coins;
    use std::cell::RefCell;

    struct Shares(RefCell<Vec<f64>>);

    impl Observer for Shares {
        fn busy(&self, activity: Activity, share: f64) {
            assert_eq!(activity, Activity::Evaluation);
            self.0.borrow_mut().push(share);
        }
    }

    #[test]
    fn a_long_episode_is_never_silent() {
        let mut coins = Coins::new(4).baseline("copy").unwrap();
        let shares = Shares(RefCell::default());
        let mut controller = Reporting::new(&mut *coins.controller, &shares, Activity::Evaluation, 8);
        for episode in 0..2 {
            play(&mut *coins.simulator, &mut controller, Seed::new(3).for_episode(episode)).unwrap();
        }
        assert_eq!(*shares.0.borrow(), [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0]);
    }
}
