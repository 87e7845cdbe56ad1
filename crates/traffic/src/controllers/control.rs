//! Hand-coded control of lights: the trait of controllers.

use super::intersections::{Intersection, Intersections};
use dials_core::base::Seed;
use dials_core::domain::Action;

/// Decides for the lights of all intersections.
pub trait LightController {
    /// Begins an episode. Everything random in the decisions follows from `episode`.
    fn begin(&mut self, _episode: Seed) {}

    /// Sets the green that each light should show: one index per intersection. Each target comes as the green that is
    /// shown or comes next, so a target that is left alone keeps the light. Targets between greens have no effect.
    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]);
}

/// A rule that every intersection follows on its own. It returns the green that the light should show.
pub struct Each<F: FnMut(&Intersection<'_>) -> usize>(pub F);

impl<F: FnMut(&Intersection<'_>) -> usize> LightController for Each<F> {
    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        targets
            .iter_mut()
            .zip(intersections.iter())
            .for_each(|(target, intersection)| *target = (self.0)(&intersection));
    }
}

/// Writes the action for each light by which it goes where the controller wants it.
pub(crate) fn ask(controller: &mut dyn LightController, intersections: &Intersections<'_>, actions: &mut [Action]) {
    let mut targets: Vec<usize> = intersections.shown.iter().map(|shown| shown.target()).collect();
    controller.act(intersections, &mut targets);
    for ((action, target), at) in actions.iter_mut().zip(targets).zip(intersections.iter()) {
        let greens = at.plan().greens();
        assert!(target < greens, "a controller wants green {target} of light {}, which has {greens}", at.plan().light);
        *action = at.plan().phases.towards(at.shown(), target);
    }
}

/// Hand-coded control of lights.
pub enum HandCoded {
    /// The program of each light in its net.
    OwnProgram,
    /// SUMO's own actuated program.
    Actuated,
    Rule(Box<dyn LightController>),
}

impl HandCoded {
    pub fn rule(controller: impl LightController + 'static) -> HandCoded {
        HandCoded::Rule(Box::new(controller))
    }
}
