//! One shape for all agents: as wide as the widest observation, with as many actions as the light with the most greens.

use crate::traffic::agents::plan::AgentPlan;

/// The common shape of agents that form one kind. Smaller agents have columns of zeros at the end, and actions at the
/// end that they must not take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Padding {
    /// Number of columns of every observation.
    pub columns: usize,
    /// Number of actions of every agent.
    pub actions: usize,
    /// Share of the columns of all agents that are padding, from 0 to 1.
    pub padded: f64,
}

impl Padding {
    /// Returns the shape of these agents; at least one.
    pub fn of<'a>(plans: impl Iterator<Item = &'a AgentPlan> + Clone) -> Padding {
        let agents = plans.clone().count();
        let widths = plans.clone().map(|plan| plan.sensor.width());
        let columns = widths.clone().max().expect("a net has agents");
        let actions = plans.map(|plan| plan.phases.actions()).max().expect("a net has agents");
        let padded = 1.0 - widths.sum::<usize>() as f64 / (agents * columns) as f64;
        Padding { columns, actions, padded }
    }
}
