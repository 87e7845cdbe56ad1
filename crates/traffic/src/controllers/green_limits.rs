//! The shortest and the longest green of lights that look at the traffic.

use anyhow::Result;

use super::are_of_a_grid;
use super::arguments::Arguments;
use super::intersections::Intersection;
use crate::agents::plan::AgentPlan;

/// Steps of the longest green on nets that are no grid, as SUMO's actuated lights have. Without an end, a car that waits
/// for a gap on a lane with green may hold it for ever.
const MOST: u32 = 50;

/// Numbers of steps of a green.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct GreenLimits {
    pub(crate) least: u32,
    /// After this many steps a green gives way to any other one that is wanted; `None`: never.
    pub(crate) most: Option<u32>,
}

/// Returns the limits of a grid. Of 1 to 15, max-pressure does best with these on 2x2 (184, against 173 with 5 or 1). For
/// longest-queue, all values from 5 on give the same result.
impl Default for GreenLimits {
    fn default() -> Self {
        GreenLimits { least: 10, most: None }
    }
}

impl GreenLimits {
    /// Returns the limits for the parameters `min-green` and `max-green`.
    pub(super) fn of(arguments: &mut Arguments<'_>, plans: &[AgentPlan]) -> Result<GreenLimits> {
        let least = arguments.steps("min-green", GreenLimits::default().least)?;
        let limits = GreenLimits { least, ..GreenLimits::longest(arguments, plans)? };
        match limits.most {
            Some(most) if most < least => {
                Err(arguments.refuse(format!("min-green = {least}: must be at most max-green, {most}")))
            }
            _ => Ok(limits),
        }
    }

    /// Returns the limits for the parameter `max-green`, with no shortest green.
    pub(super) fn longest(arguments: &mut Arguments<'_>, plans: &[AgentPlan]) -> Result<GreenLimits> {
        let usual = GreenLimits { least: 0, ..GreenLimits::usual(plans) };
        Ok(GreenLimits { most: arguments.steps_if_given("max-green")?.or(usual.most), ..usual })
    }

    /// Returns the limits that these lights have if no parameter says otherwise.
    pub(super) fn usual(plans: &[AgentPlan]) -> GreenLimits {
        GreenLimits { most: (!are_of_a_grid(plans)).then_some(MOST), ..GreenLimits::default() }
    }

    /// Returns the green that is shown, if it has lasted long enough.
    pub(crate) fn may_leave(self, at: &Intersection<'_>) -> Option<usize> {
        at.green().filter(|_| at.shown_steps() >= self.least)
    }

    /// Returns whether the longest green is over.
    pub(crate) fn must_leave(self, at: &Intersection<'_>) -> bool {
        self.most.is_some_and(|most| at.shown_steps() >= most)
    }
}
