//! Simulators and controllers whose calls are timed.

use std::time::{Duration, Instant};

use dials_core::base::{Phase, Rows, Seed, Stopwatch};
use dials_core::domain::{
    Action, Beginning, Controller, GlobalSimulator, InfluenceSample, JointPercept, JointTransition, Kinds,
    LocalSimulator, Measures, Percept, RegionSpec, Result, RoadView, Scene, Transition,
};

/// A simulator whose steps and resets are timed from outside. Phases that the simulator itself measured within its
/// steps, see [`GlobalSimulator::take_watch`], are subtracted.
pub(crate) struct Timed<S: ?Sized> {
    inner: Box<S>,
    steps: Duration,
    resets: Duration,
}

impl<S: ?Sized> Timed<S> {
    pub(crate) fn new(inner: Box<S>) -> Self {
        Timed { inner, steps: Duration::ZERO, resets: Duration::ZERO }
    }

    /// Splits the measured times into phases. `told`: what the simulator itself measured within its steps.
    fn split(&mut self, told: Stopwatch) -> Stopwatch {
        let mut watch = told;
        let untold = self.steps.saturating_sub(watch.total());
        watch.note(Phase::SimulatorStep, untold);
        watch.note(Phase::Reset, self.resets);
        (self.steps, self.resets) = (Duration::ZERO, Duration::ZERO);
        watch
    }
}

impl GlobalSimulator for Timed<dyn GlobalSimulator> {
    fn kinds(&self) -> &Kinds {
        self.inner.kinds()
    }

    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        let begun = Instant::now();
        let percept = self.inner.reset(episode);
        self.resets += begun.elapsed();
        percept
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        let begun = Instant::now();
        let transition = self.inner.step(actions);
        self.steps += begun.elapsed();
        transition
    }

    fn observe_influence(&mut self) -> Result<()> {
        self.inner.observe_influence()
    }

    fn influence_sample(&self) -> InfluenceSample<'_> {
        self.inner.influence_sample()
    }

    fn advise(&mut self, actions: &mut [Action]) -> bool {
        self.inner.advise(actions)
    }

    fn carried_out(&self, actions: &mut [Option<Action>]) {
        self.inner.carried_out(actions);
    }

    fn measures(&mut self) -> Result<Measures> {
        self.inner.measures()
    }

    fn measure_in_full(&mut self) -> Result<()> {
        self.inner.measure_in_full()
    }

    fn watch_roads(&mut self) -> bool {
        self.inner.watch_roads()
    }

    fn roads(&self) -> Vec<RoadView> {
        self.inner.roads()
    }

    fn watch_scene(&mut self) -> Result<()> {
        self.inner.watch_scene()
    }

    fn scene(&self) -> Option<Scene> {
        self.inner.scene()
    }

    fn take_watch(&mut self) -> Stopwatch {
        let told = self.inner.take_watch();
        self.split(told)
    }
}

impl LocalSimulator for Timed<dyn LocalSimulator> {
    fn spec(&self) -> &RegionSpec {
        self.inner.spec()
    }

    fn rows(&self) -> usize {
        self.inner.rows()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        let begun = Instant::now();
        let percept = self.inner.reset(begin);
        self.resets += begun.elapsed();
        percept
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        let begun = Instant::now();
        let transition = self.inner.step(actions, sources);
        self.steps += begun.elapsed();
        transition
    }

    fn counters(&self) -> Vec<(&'static str, u64)> {
        self.inner.counters()
    }

    fn take_watch(&mut self) -> Stopwatch {
        let told = self.inner.take_watch();
        self.split(told)
    }
}

/// A controller whose decisions are timed.
pub(crate) struct TimedController<C> {
    inner: C,
    pub(crate) watch: Stopwatch,
}

impl<C: Controller> TimedController<C> {
    pub(crate) fn new(inner: C) -> Self {
        TimedController { inner, watch: Stopwatch::default() }
    }
}

impl<C: Controller> Controller for TimedController<C> {
    fn begin(&mut self, episode: Seed) {
        self.inner.begin(episode);
    }

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        self.watch.time(Phase::Acting, || self.inner.act(percept, actions))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::base::AgentId;
    use dials_core::domain::Domain;
    use dials_testkit::toy::Coins;

    /// A simulator that reports a part of its steps as reading.
    struct Telling(Duration);

    impl LocalSimulator for Telling {
        fn spec(&self) -> &RegionSpec {
            unreachable!("not used in these tests")
        }

        fn rows(&self) -> usize {
            1
        }

        fn reset(&mut self, _begin: &[Beginning]) -> Result<&Percept> {
            unreachable!("not used in these tests")
        }

        fn step(&mut self, _actions: &[Action], _sources: &Rows<u8>) -> Result<&Transition> {
            anyhow::bail!("this one only reports times")
        }

        fn counters(&self) -> Vec<(&'static str, u64)> {
            Vec::new()
        }

        fn take_watch(&mut self) -> Stopwatch {
            let mut watch = Stopwatch::default();
            watch.note(Phase::Reading, self.0);
            watch
        }
    }

    /// A GS that says when it is asked to measure in full.
    struct Asked(Box<dyn GlobalSimulator>);

    impl GlobalSimulator for Asked {
        fn kinds(&self) -> &Kinds {
            self.0.kinds()
        }

        fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
            self.0.reset(episode)
        }

        fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
            self.0.step(actions)
        }

        fn influence_sample(&self) -> InfluenceSample<'_> {
            self.0.influence_sample()
        }

        fn measure_in_full(&mut self) -> Result<()> {
            anyhow::bail!("this one was asked")
        }
    }

    #[test]
    fn the_order_to_measure_in_full_reaches_the_simulator() {
        let asked: Box<dyn GlobalSimulator> = Box::new(Asked(Coins::new(1).global_simulator().unwrap()));
        assert_eq!(Timed::new(asked).measure_in_full().unwrap_err().to_string(), "this one was asked");
    }

    #[test]
    fn what_a_simulator_does_not_tell_of_a_step_is_its_own_step() {
        let told = Duration::from_secs(2);
        let mut timed: Timed<dyn LocalSimulator> = Timed::new(Box::new(Telling(told)));
        timed.steps = Duration::from_secs(7);
        timed.resets = Duration::from_secs(1);
        let watch = timed.take_watch();
        let seconds = |phase| watch.spent(phase).as_secs();
        assert_eq!((seconds(Phase::Reading), seconds(Phase::SimulatorStep), seconds(Phase::Reset)), (2, 5, 1));
        assert_eq!(timed.take_watch().total(), told, "the second call returns only what was reported since the first");
    }

    #[test]
    fn steps_and_resets_of_a_silent_simulator_are_timed() {
        let coins = Coins::new(4);
        let mut timed = Timed::new(coins.local_simulator(&[AgentId(0)], 1, Seed::new(0)).unwrap());
        timed.reset(&Beginning::first([0])).unwrap();
        timed.step(&[1], &Rows::new(1, 1)).unwrap();
        let watch = timed.take_watch();
        assert!(watch.spent(Phase::SimulatorStep) > Duration::ZERO && watch.spent(Phase::Reset) > Duration::ZERO);
        assert_eq!(watch.total(), watch.spent(Phase::SimulatorStep) + watch.spent(Phase::Reset));
        assert_eq!(timed.take_watch().total(), Duration::ZERO);
    }
}
