//! Fixed time: every light follows a clock, whatever the traffic.

use super::control::LightController;
use super::intersections::Intersections;
use super::timing::Timing;
use dials_core::base::Seed;

/// Fixed-time lights: one timing per intersection. Every episode begins with the first green; if the clock says
/// otherwise, the light changes at once.
pub(crate) struct FixedTime {
    timings: Vec<Timing>,
    step: u32,
}

impl FixedTime {
    pub(crate) fn new(timings: Vec<Timing>) -> Self {
        FixedTime { timings, step: 0 }
    }
}

impl LightController for FixedTime {
    fn begin(&mut self, _episode: Seed) {
        self.step = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        for ((target, shown), timing) in targets.iter_mut().zip(intersections.shown).zip(&self.timings) {
            if shown.is_green() {
                *target = timing.target(self.step);
            }
        }
        self.step += 1;
    }
}
