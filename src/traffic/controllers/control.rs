//! Hand-coded control of lights: the trait of controllers, and what they can measure.

use anyhow::Result;

use super::intersections::{Intersection, Intersections};
use crate::base::Seed;
use crate::domain::{Action, GlobalSimulator};

/// Decides for the lights of all intersections.
pub trait LightController {
    /// Begins an episode. Everything random in the decisions follows from `episode`.
    fn begin(&mut self, _episode: Seed) {}

    /// Decides for each light whether to keep it or to switch: one action per intersection. Actions during yellow have
    /// no effect.
    fn act(&mut self, intersections: &Intersections<'_>, actions: &mut [Action]);
}

/// A rule that every intersection follows on its own.
pub struct Each<F: FnMut(&Intersection<'_>) -> Action>(pub F);

impl<F: FnMut(&Intersection<'_>) -> Action> LightController for Each<F> {
    fn act(&mut self, intersections: &Intersections<'_>, actions: &mut [Action]) {
        actions
            .iter_mut()
            .zip(intersections.iter())
            .for_each(|(action, intersection)| *action = (self.0)(&intersection));
    }
}

/// Hand-coded control of lights.
pub enum HandCoded {
    /// SUMO's own actuated program.
    Actuated,
    Rule(Box<dyn LightController>),
}

impl HandCoded {
    pub fn rule(controller: impl LightController + 'static) -> HandCoded {
        HandCoded::Rule(Box::new(controller))
    }
}

/// Trial runs, for a controller that must measure something before it begins.
pub trait Trials {
    /// Loads the GS (global simulator) with all lights under this control.
    fn load_gs(&self, by: HandCoded) -> Result<Box<dyn GlobalSimulator>>;

    /// Returns the number of steps in an episode.
    fn horizon(&self) -> usize;
}
