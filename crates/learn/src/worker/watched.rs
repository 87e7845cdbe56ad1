//! A controller in episodes on the GS that a worker plays: it measures what they cost, and reports at every decision. A
//! whole day of a large map takes longer than the coordinator waits for a word of its workers.

use std::time::{Duration, Instant};

use crate::environments::add_steps;
use crate::observer::Observer;
use dials_core::base::{Activity, Phase, Seed, Stopwatch};
use dials_core::domain::{Action, Controller, GlobalSimulator, JointPercept, Result};

/// A controller whose calls say what the simulator does: between two of them it begins an episode, or makes a step.
pub(crate) struct Watched<'a> {
    inner: &'a mut dyn Controller,
    observer: &'a dyn Observer,
    activity: Activity,
    /// Number of decisions so far, and in all episodes.
    decided: usize,
    all: usize,
    last_call: Instant,
    is_reset: bool,
    steps: Duration,
    watch: Stopwatch,
}

impl<'a> Watched<'a> {
    /// `decisions`: the number of decisions in all episodes that will be played.
    pub(crate) fn new(
        inner: &'a mut dyn Controller,
        observer: &'a dyn Observer,
        activity: Activity,
        decisions: usize,
    ) -> Watched<'a> {
        Watched {
            inner,
            observer,
            activity,
            decided: 0,
            all: decisions,
            last_call: Instant::now(),
            is_reset: true,
            steps: Duration::ZERO,
            watch: Stopwatch::default(),
        }
    }

    /// Notes what the simulator did since the last call.
    fn note_simulator(&mut self) {
        let spent = self.last_call.elapsed();
        if self.is_reset { self.watch.note(Phase::Reset, spent) } else { self.steps += spent }
    }

    /// Adds the times of all episodes.
    pub(crate) fn add_to(mut self, watch: &mut Stopwatch, simulator: &mut dyn GlobalSimulator) {
        self.note_simulator();
        watch.add(&self.watch);
        add_steps(watch, &simulator.take_watch(), self.steps);
    }
}

impl Controller for Watched<'_> {
    fn decides(&self) -> bool {
        self.inner.decides()
    }

    fn begin(&mut self, episode: Seed) {
        self.note_simulator();
        self.inner.begin(episode);
        (self.is_reset, self.last_call) = (true, Instant::now());
    }

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        self.note_simulator();
        self.decided += 1;
        self.observer.busy(self.activity, self.decided as f64 / self.all as f64);
        self.watch.time(Phase::Acting, || self.inner.act(percept, actions))?;
        (self.is_reset, self.last_call) = (false, Instant::now());
        Ok(())
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
        let mut controller = Watched::new(&mut *coins.controller, &shares, Activity::Evaluation, 8);
        for episode in 0..2 {
            play(&mut *coins.simulator, &mut controller, Seed::new(3).for_episode(episode)).unwrap();
        }
        assert_eq!(*shares.0.borrow(), [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0]);
    }
}
