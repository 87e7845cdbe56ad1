//! Controllers that do not look at the traffic: random, and every K steps.

use rand::Rng;

use super::control::LightController;
use super::intersections::Intersections;
use dials_core::base::{Dice, RandomPurpose, Seed};

/// Leaves its green with probability one half, independently for each light and step. All other greens are equally
/// likely.
pub(crate) struct Random {
    dice: Dice,
}

impl Random {
    pub(crate) fn new(episode: Seed) -> Self {
        Random { dice: episode.fork(RandomPurpose::Acting).dice() }
    }
}

impl LightController for Random {
    fn begin(&mut self, episode: Seed) {
        *self = Random::new(episode);
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        for (target, at) in targets.iter_mut().zip(intersections.iter()) {
            if self.dice.random::<bool>() {
                let others = at.plan().greens() - 1;
                let steps = if others == 1 { 1 } else { self.dice.random_range(1..=others) };
                *target = (*target + steps) % (others + 1);
            }
        }
    }
}

/// Sends all lights to their next green at every K-th step: some steps of yellow, the rest of green (at least one).
pub(crate) struct SwitchEvery {
    steps: usize,
    step: usize,
}

impl SwitchEvery {
    pub(crate) fn new(steps: usize) -> Self {
        SwitchEvery { steps, step: 0 }
    }
}

impl LightController for SwitchEvery {
    fn begin(&mut self, _episode: Seed) {
        self.step = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        self.step += 1;
        if self.step.is_multiple_of(self.steps) {
            targets.iter_mut().zip(intersections.plans).for_each(|(target, plan)| *target = plan.phases.next(*target));
        }
    }
}
