//! One shape for all agents: as wide as the widest observation, with as many actions as the light with the most greens.

use crate::agents::plan::{AgentPlan, Border};

/// The shape of agents that form one kind. Smaller ones have zeros and forbidden actions at the end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Padding {
    pub columns: usize,
    pub actions: usize,
    /// Share of the columns of all agents that are padding, from 0 to 1.
    pub padded: f64,
}

impl Padding {
    /// Returns the shape of these agents; zeros if there is none.
    pub fn of<'a>(plans: impl Iterator<Item = &'a AgentPlan> + Clone) -> Padding {
        let agents = plans.clone().count();
        let widths = plans.clone().map(|plan| plan.width());
        let columns = widths.clone().max().unwrap_or(0);
        let actions = plans.map(|plan| plan.phases.actions()).max().unwrap_or(0);
        let cells = agents * columns;
        let padded = (cells - widths.sum::<usize>()) as f64 / cells.max(1) as f64;
        Padding { columns, actions, padded }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InfluencePadding {
    pub columns: usize,
    /// Number of influence sources of every agent. Those that an agent does not have never happen.
    pub sources: usize,
    pub(crate) parts: usize,
}

impl InfluencePadding {
    pub fn of<'a>(borders: impl Iterator<Item = &'a Border> + Clone) -> InfluencePadding {
        let largest = |of_border: fn(&Border) -> usize| borders.clone().map(of_border).max().unwrap_or(0);
        InfluencePadding {
            columns: largest(|border| border.d_set.width(&border.plan)),
            sources: largest(|border| border.plan.sources()),
            parts: largest(|border| border.d_set.parts()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::derive::overrides::Overrides;
    use crate::agents::derive::{Rules, derive};
    use crate::network::roads::example::{LIGHT_AT_U, roads};

    #[test]
    fn agents_of_one_kind_are_as_wide_as_the_widest() {
        let overrides = Overrides::parse("[light.U]\ngreens = ['Grr', 'rGG', 'rrG']").unwrap();
        let plans = derive(&roads(&LIGHT_AT_U), &Rules::default(), &overrides).unwrap().plans();
        // J sees 10 + 5 + 5 cells and has two greens; U sees 15 + 8 + 5 cells and has three.
        assert_eq!(plans.iter().map(|plan| plan.width()).collect::<Vec<_>>(), [24, 33]);
        let padding = Padding::of(plans.iter());
        assert_eq!((padding.columns, padding.actions), (33, 3));
        assert!((padding.padded - 9.0 / 66.0).abs() < 1e-12, "{}", padding.padded);
    }
}
