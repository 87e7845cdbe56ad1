//! Controllers that do not look at the traffic: random, never, always, every K steps.

use rand::Rng;

use super::control::LightController;
use crate::base::{Dice, RandomPurpose, Seed};
use crate::domain::Action;
use crate::traffic::controllers::intersections::Intersections;
use crate::traffic::light::{KEEP, SWITCH};

/// Switches with probability one half, independently for each light and step.
pub struct Random {
    dice: Dice,
}

impl Random {
    pub fn new(episode: Seed) -> Self {
        Random { dice: episode.fork(RandomPurpose::Acting).dice() }
    }
}

impl LightController for Random {
    fn begin(&mut self, episode: Seed) {
        *self = Random::new(episode);
    }

    fn act(&mut self, _intersections: &Intersections<'_>, actions: &mut [Action]) {
        actions.fill_with(|| Action::from(self.dice.random::<bool>()));
    }
}

/// Takes the same action at every step.
pub struct Constant(Action);

impl Constant {
    pub fn never() -> Self {
        Constant(KEEP)
    }

    pub fn always() -> Self {
        Constant(SWITCH)
    }
}

impl LightController for Constant {
    fn act(&mut self, _intersections: &Intersections<'_>, actions: &mut [Action]) {
        actions.fill(self.0);
    }
}

/// Switches all lights at every K-th step: three steps of yellow, K - 3 of green (at least one).
pub struct SwitchEvery {
    steps: usize,
    step: usize,
}

impl SwitchEvery {
    pub fn new(steps: usize) -> Self {
        SwitchEvery { steps, step: 0 }
    }
}

impl LightController for SwitchEvery {
    fn begin(&mut self, _episode: Seed) {
        self.step = 0;
    }

    fn act(&mut self, _intersections: &Intersections<'_>, actions: &mut [Action]) {
        self.step += 1;
        actions.fill(if self.step.is_multiple_of(self.steps) { SWITCH } else { KEEP });
    }
}
