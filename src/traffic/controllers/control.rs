//! What hand-coded control of lights is: the trait of controllers, and what they may ask for.

use anyhow::Result;

use super::intersections::{Intersection, Intersections};
use crate::base::Seed;
use crate::domain::{Action, GlobalSimulator};

/// Decides for the lights of all intersections.
pub trait LightController {
    /// An episode begins; everything random in the decisions follows from `episode`.
    fn begin(&mut self, _episode: Seed) {}

    /// Decides whether each light shall keep what it shows or switch, one action per intersection. What is said during
    /// yellow is not heard.
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

/// What a controller may use to measure something before it begins.
pub trait Trials {
    /// Loads the GS with all lights under this control.
    fn load_gs(&self, by: HandCoded) -> Result<Box<dyn GlobalSimulator>>;

    /// Returns the number of steps in an episode.
    fn horizon(&self) -> usize;
}
