//! Opponents: the controller and the group that the groups of a scenario are compared with.

use super::compare::steps::are_alike;
use super::finals::Final;
use super::group::{Comparison, Group};
use dials_core::base::statistics::difference::{Difference, Episodes, Played, between, to_controller};
use dials_session::records::find::BaselineRecord;

/// A controller or a group whose return is subtracted from those of the groups of a scenario.
pub(crate) enum Opponent<'a> {
    Controller(&'a BaselineRecord),
    Group(&'a Group, String),
}

impl Opponent<'_> {
    pub(crate) fn name(&self) -> &str {
        match self {
            Opponent::Controller(controller) => &controller.controller,
            Opponent::Group(_, name) => name,
        }
    }

    /// Returns the episodes of its final return; `None` if its runs have different ones.
    pub(crate) fn episodes(&self) -> Option<Episodes> {
        match self {
            Opponent::Controller(controller) => Some(played(controller).episodes),
            Opponent::Group(group, _) => Final::of(group)?.episodes(),
        }
    }

    /// Returns a group's final return minus the opponent's; `None` for itself, and if the steps are not alike.
    pub(crate) fn difference(&self, group: &Group, end: &Final) -> Option<Difference> {
        match self {
            Opponent::Controller(controller) => Some(to_controller(&end.runs, &played(controller))),
            Opponent::Group(other, _) if std::ptr::eq(*other, group) => None,
            Opponent::Group(other, _) => {
                let of_other = Final::of(other)?;
                are_alike([of_other.steps, end.steps]).then(|| between(&of_other.runs, &end.runs))
            }
        }
    }
}

fn played(controller: &BaselineRecord) -> Played {
    Played::new(controller.mean_return, controller.seed, controller.episode_returns.clone())
}

impl Comparison {
    pub(crate) fn reference(&self) -> Option<Opponent<'_>> {
        Some(Opponent::Group(&self.groups[self.reference?], "the reference".to_owned()))
    }

    /// Returns the strongest controller measured, and the reference, or else the first of several groups.
    pub(crate) fn opponents(&self) -> Vec<Opponent<'_>> {
        let strongest = self.baselines.iter().max_by(|a, b| a.mean_return.total_cmp(&b.mean_return));
        let first = || match &self.groups[..] {
            [first, _, ..] => Some(Opponent::Group(first, first.label())),
            _ => None,
        };
        strongest.map(Opponent::Controller).into_iter().chain(self.reference().or_else(first)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;
    use dials_session::records::run_record::RunRecord;

    #[test]
    fn groups_are_compared_if_they_end_at_the_same_step_up_to_a_hundredth() {
        let group = |total_steps: u64, mean| {
            let run = fixtures::run(&format!("total_steps = {total_steps}"));
            fixtures::group(vec![RunRecord { evaluations: vec![fixtures::evaluation(total_steps, mean)], ..run }])
        };
        let reference = group(200_704, 10.0);
        let opponent = Opponent::Group(&reference, "reference".to_owned());
        let minus_reference = |total_steps| {
            let other = group(total_steps, 12.0);
            opponent.difference(&other, &Final::of(&other).unwrap()).map(|found| found.mean)
        };
        assert_eq!([200_704, 200_064, 190_000].map(minus_reference), [Some(2.0), Some(2.0), None]);
    }
}
