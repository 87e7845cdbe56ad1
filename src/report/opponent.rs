//! Opponents: the controller and the group that the groups of a scenario are compared with.

use super::finals::Final;
use super::find::BaselineRecord;
use super::group::{Comparison, Group};
use super::played::minus_controller;
use crate::base::statistics::difference::{Difference, between};

/// A controller or a group whose return is subtracted from those of the groups of a scenario.
#[derive(Clone)]
pub enum Opponent<'a> {
    Controller(&'a BaselineRecord),
    /// A group and its name.
    Group(&'a Group, String),
}

impl Opponent<'_> {
    pub fn name(&self) -> &str {
        match self {
            Opponent::Controller(controller) => &controller.controller,
            Opponent::Group(_, name) => name,
        }
    }

    /// Returns the final return of a group minus the opponent's. `None` for the opponent itself, and if the two were
    /// measured at different steps.
    pub fn difference(&self, group: &Group, end: &Final) -> Option<Difference> {
        match self {
            Opponent::Controller(controller) => Some(minus_controller(&end.runs, controller)),
            Opponent::Group(other, _) if std::ptr::eq(*other, group) => None,
            Opponent::Group(other, _) => {
                let of_other = Final::of(other)?;
                (of_other.steps == end.steps).then(|| between(&of_other.runs, &end.runs))
            }
        }
    }
}

impl Comparison {
    /// Returns the reference of an ablation as an opponent.
    pub fn reference(&self) -> Option<Opponent<'_>> {
        Some(Opponent::Group(&self.groups[self.reference?], "the reference".to_owned()))
    }

    /// Returns the strongest controller, if any was measured, and the reference. If there is no reference, the first of
    /// several groups takes its place.
    pub fn opponents(&self) -> Vec<Opponent<'_>> {
        let strongest = self.baselines.iter().max_by(|a, b| a.mean_return.total_cmp(&b.mean_return));
        let first = || match &self.groups[..] {
            [first, _, ..] => Some(Opponent::Group(first, first.label())),
            _ => None,
        };
        strongest.map(Opponent::Controller).into_iter().chain(self.reference().or_else(first)).collect()
    }
}
