//! Learning curves: returns and losses of the runs of a group, step by step.
//!
//! A curve has a point at every step at which some run of the group was evaluated. Between two evaluations, a run
//! counts with a linear interpolation. After its last evaluation it does not count. A point knows how many runs count
//! at it.

use std::collections::{BTreeMap, BTreeSet};

use super::group::Group;
use dials_core::base::statistics::{Spread, mean};
use dials_session::records::run_record::RunRecord;

pub(crate) struct CurvePoint {
    /// Timesteps per agent.
    pub(crate) steps: u64,
    pub(crate) returns: Spread,
    /// Return of the median agent of a run, mean over seeds.
    pub(crate) median_agent: f64,
    /// Mean wall time of these runs until here in seconds, without evaluations; `None` unless all of them know it.
    pub(crate) runtime_s: Option<f64>,
    /// Likewise their CPU time, of all processes.
    pub(crate) cpu_s: Option<f64>,
}

pub(crate) struct LossPoint {
    pub(crate) steps: u64,
    /// Whether the loss was measured right after a training of the AIPs.
    pub(crate) after_training: bool,
    /// Cross-entropy in nats per influence source, over seeds.
    pub(crate) loss: Spread,
    /// Cross-entropy of constant marginals, mean over seeds.
    pub(crate) marginals: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LossData {
    /// Fresh episodes of the GS, at evaluations and after trainings.
    Fresh,
    /// The held-out episodes of each dataset, before and after the training on it.
    HeldOut,
}

pub(crate) fn learning_curve(group: &Group) -> Vec<CurvePoint> {
    let steps: BTreeSet<u64> =
        group.runs.iter().flat_map(|run| run.evaluations.iter().map(|evaluation| evaluation.steps)).collect();
    let points = steps.into_iter().filter_map(|steps| {
        let here: Vec<&RunRecord> = group.runs.iter().filter(|run| run.return_at(steps).is_some()).collect();
        let all =
            |figure: &dyn Fn(&RunRecord) -> Option<f64>| here.iter().filter_map(|run| figure(run)).collect::<Vec<_>>();
        let mean_time = |figure: &dyn Fn(&RunRecord) -> Option<f64>| {
            let times = all(figure);
            (times.len() == here.len()).then(|| mean(&times))
        };
        Some(CurvePoint {
            steps,
            returns: Spread::of(&all(&|run| run.return_at(steps)))?,
            median_agent: mean(&all(&|run| run.median_at(steps))),
            runtime_s: mean_time(&|run| run.runtime_at(steps)),
            cpu_s: mean_time(&|run| run.cpu_at(steps)),
        })
    });
    points.collect()
}

/// Makes the curve of the cross-entropy of a group's AIPs, on fresh GS episodes if any run measured that.
///
/// Runs need not train at the same steps: at the training of one, the others count with their value at that step.
pub(crate) fn loss_curve(group: &Group) -> (LossData, Vec<LossPoint>) {
    let fresh = group.runs.iter().any(|run| !run.fresh_losses.is_empty());
    let data = if fresh { LossData::Fresh } else { LossData::HeldOut };
    let of_runs: Vec<LossesBySteps> = group.runs.iter().map(|run| measured(run, data)).collect();
    let places: BTreeSet<(u64, bool)> = of_runs.iter().flat_map(|run| run.keys().copied()).collect();
    let points = places.into_iter().filter_map(|(steps, after_training)| {
        let here: Vec<[f64; 2]> = of_runs.iter().filter_map(|run| loss_at(run, steps, after_training)).collect();
        let loss = Spread::of(&here.iter().map(|[loss, _]| *loss).collect::<Vec<_>>())?;
        let marginals = mean(&here.iter().map(|[_, marginals]| *marginals).collect::<Vec<_>>());
        Some(LossPoint { steps, after_training, loss, marginals })
    });
    (data, points.collect())
}

/// Returns the trainings after step 0 that only some runs of a group have: steps and the loss right after.
pub(crate) fn single_trainings(group: &Group) -> Vec<(u64, f64)> {
    let of_runs: Vec<LossesBySteps> = group.runs.iter().map(|run| measured(run, LossData::Fresh)).collect();
    let trainings = of_runs.iter().flatten().filter(|((steps, after_training), _)| *after_training && *steps > 0);
    let single = trainings.filter(|(place, _)| {
        of_runs.iter().any(|run| !run.contains_key(place) && loss_at(run, place.0, true).is_some())
    });
    single.map(|((steps, _), [loss, _])| (*steps, *loss)).collect()
}

/// Losses of a run's AIPs and of constant marginals, by steps and whether right after a training.
pub(crate) type LossesBySteps = BTreeMap<(u64, bool), [f64; 2]>;

/// Returns the losses before or after a training at a step. Between two steps it interpolates; outside: `None`.
fn loss_at(run: &LossesBySteps, steps: u64, after_training: bool) -> Option<[f64; 2]> {
    let here: Vec<[f64; 2]> = run.range((steps, false)..=(steps, true)).map(|(_, loss)| *loss).collect();
    if let Some(loss) = if after_training { here.last() } else { here.first() } {
        return Some(*loss);
    }
    let ((left, _), before) = run.range(..(steps, false)).next_back()?;
    let ((right, _), behind) = run.range((steps, true)..).next()?;
    let share = (steps - left) as f64 / (right - left) as f64;
    Some(std::array::from_fn(|index| before[index] + share * (behind[index] - before[index])))
}

pub(crate) fn measured(run: &RunRecord, data: LossData) -> LossesBySteps {
    match data {
        LossData::Fresh => run
            .fresh_losses
            .iter()
            .map(|fresh| ((fresh.steps, fresh.after_training), [fresh.loss, fresh.marginals]))
            .collect(),
        LossData::HeldOut => run
            .aip_trainings
            .iter()
            .flat_map(|training| {
                let at = |after, loss| ((training.steps, after), [loss, training.marginals]);
                [at(false, training.before), at(true, training.after)]
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;
    use dials_session::records::run_record::FreshLossRecord;

    /// Makes runs with losses at these steps; `true`: right after a training. The marginals are 1 higher.
    fn group(runs: &[&[(u64, bool, f64)]]) -> Group {
        let record = |&(steps, after_training, loss): &(u64, bool, f64)| FreshLossRecord {
            steps,
            after_training,
            loss,
            marginals: loss + 1.0,
        };
        let run = |losses: &&[(u64, bool, f64)]| RunRecord {
            fresh_losses: losses.iter().map(record).collect(),
            ..fixtures::run("")
        };
        fixtures::group(runs.iter().map(run).collect())
    }

    #[test]
    fn a_seed_that_trains_when_others_do_not_or_has_just_begun_leaves_the_others_in_the_curve() {
        let drift = group(&[
            &[(0, true, 2.0), (100, false, 4.0), (100, true, 1.0), (200, false, 2.0)],
            &[(0, true, 4.0), (200, false, 8.0)],
            &[(0, true, 6.0)],
        ]);
        let (_, points) = loss_curve(&drift);
        let found: Vec<(u64, bool, usize, f64)> = points
            .iter()
            .map(|point| (point.steps, point.after_training, point.loss.runs(), point.loss.mean))
            .collect();
        // At 100 the second run is half way from 4 to 8. The third run ended earlier.
        let expected = [(0, true, 3, 4.0), (100, false, 2, 5.0), (100, true, 2, 3.5), (200, false, 2, 5.0)];
        assert_eq!(found, expected);
        assert_eq!(points[1].marginals, 6.0);
        assert_eq!(single_trainings(&drift), [(100, 1.0)]);
        assert_eq!(
            single_trainings(&group(&[&[(0, true, 2.0), (9, true, 1.0)], &[(0, true, 2.0), (9, true, 3.0)]])),
            []
        );
    }
}
