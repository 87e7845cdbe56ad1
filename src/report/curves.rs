//! Learning curves: what the runs of a group say together, step by step.
//!
//! Runs of unequal length: a curve has a point at every step at which some run of the group was evaluated. A run counts
//! at a point if it has come so far, interpolated on a straight line between two of its evaluations, and is never
//! prolonged beyond its last one. A point tells how many runs it stands for.

use std::collections::{BTreeMap, BTreeSet};

use super::group::Group;
use super::statistics::Spread;
use crate::base::statistics::mean;
use crate::records::run_record::RunRecord;

/// A point of a learning curve.
#[derive(Clone, Debug, PartialEq)]
pub struct CurvePoint {
    /// Timesteps per agent.
    pub steps: u64,
    /// Of the mean return, over seeds.
    pub returns: Spread,
    /// The median agent of a run, mean over seeds.
    pub median_agent: f64,
    /// Mean wall time of these runs until here in seconds, evaluations excluded.
    pub runtime_s: Option<f64>,
}

/// A point of a curve of cross-entropies.
#[derive(Clone, Debug, PartialEq)]
pub struct LossPoint {
    pub steps: u64,
    /// Whether the AIPs have just been trained here, or are as they were.
    pub after_training: bool,
    /// Nats per source, over seeds.
    pub loss: Spread,
    /// Of constant marginals, mean over seeds.
    pub marginals: f64,
}

/// What the cross-entropy of a group's AIPs was measured on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LossData {
    /// Fresh GS episodes at evaluations and after trainings.
    Fresh,
    /// The held-out episodes of each dataset, before and after the training on it.
    HeldOut,
}

/// The learning curve of a group.
pub fn learning_curve(group: &Group) -> Vec<CurvePoint> {
    let steps: BTreeSet<u64> =
        group.runs.iter().flat_map(|run| run.evaluations.iter().map(|evaluation| evaluation.steps)).collect();
    let points = steps.into_iter().filter_map(|steps| {
        let here: Vec<&RunRecord> = group.runs.iter().filter(|run| run.return_at(steps).is_some()).collect();
        let all =
            |figure: &dyn Fn(&RunRecord) -> Option<f64>| here.iter().filter_map(|run| figure(run)).collect::<Vec<_>>();
        let runtimes = all(&|run| run.runtime_at(steps));
        Some(CurvePoint {
            steps,
            returns: Spread::of(&all(&|run| run.return_at(steps)))?,
            median_agent: mean(&all(&|run| run.median_at(steps))),
            runtime_s: (runtimes.len() == here.len()).then(|| mean(&runtimes)),
        })
    });
    points.collect()
}

/// The cross-entropy of a group's AIPs, on fresh GS episodes where its runs measured that.
///
/// As a learning curve, at every step at which some run was measured or trained its AIPs. Runs need not train at the same
/// steps: at the training of one, the others count with what they have there.
pub fn loss_curve(group: &Group) -> (LossData, Vec<LossPoint>) {
    let fresh = group.runs.iter().any(|run| !run.fresh_losses.is_empty());
    let data = if fresh { LossData::Fresh } else { LossData::HeldOut };
    let of_runs: Vec<Measured> = group.runs.iter().map(|run| measured(run, data)).collect();
    let places: BTreeSet<(u64, bool)> = of_runs.iter().flat_map(|run| run.keys().copied()).collect();
    let points = places.into_iter().filter_map(|(steps, after_training)| {
        let here: Vec<[f64; 2]> = of_runs.iter().filter_map(|run| loss_at(run, steps, after_training)).collect();
        let loss = Spread::of(&here.iter().map(|[loss, _]| *loss).collect::<Vec<_>>())?;
        let marginals = mean(&here.iter().map(|[_, marginals]| *marginals).collect::<Vec<_>>());
        Some(LossPoint { steps, after_training, loss, marginals })
    });
    (data, points.collect())
}

/// The cross-entropies of the single runs of a group, as [`loss_curve`] has them: steps and loss.
pub fn loss_curves_of_seeds(group: &Group, data: LossData) -> Vec<Vec<(u64, bool, f64)>> {
    let curve = |run: &RunRecord| {
        measured(run, data)
            .iter()
            .map(|((steps, after_training), [loss, _])| (*steps, *after_training, *loss))
            .collect()
    };
    group.runs.iter().map(curve).collect()
}

/// Trainings of AIPs that not all runs of a group have in common, after the first: steps and the loss right after it.
pub fn single_trainings(group: &Group) -> Vec<(u64, f64)> {
    let of_runs: Vec<Measured> = group.runs.iter().map(|run| measured(run, LossData::Fresh)).collect();
    let trainings = of_runs.iter().flatten().filter(|((steps, after_training), _)| *after_training && *steps > 0);
    let single = trainings.filter(|(place, _)| {
        of_runs.iter().any(|run| !run.contains_key(place) && loss_at(run, place.0, true).is_some())
    });
    single.map(|((steps, _), [loss, _])| (*steps, *loss)).collect()
}

/// Losses of a run and of its marginals, by steps and whether the AIPs have just been trained.
type Measured = BTreeMap<(u64, bool), [f64; 2]>;

/// What a run has at a step, before or after a training if it has one there, else on the straight line between the places
/// left and right of it.
fn loss_at(run: &Measured, steps: u64, after_training: bool) -> Option<[f64; 2]> {
    let here: Vec<[f64; 2]> = run.range((steps, false)..=(steps, true)).map(|(_, loss)| *loss).collect();
    if let Some(loss) = if after_training { here.last() } else { here.first() } {
        return Some(*loss);
    }
    let ((left, _), before) = run.range(..(steps, false)).next_back()?;
    let ((right, _), behind) = run.range((steps, true)..).next()?;
    let share = (steps - left) as f64 / (right - left) as f64;
    Some(std::array::from_fn(|index| before[index] + share * (behind[index] - before[index])))
}

fn measured(run: &RunRecord, data: LossData) -> Measured {
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
    use crate::records::run_record::FreshLoss;
    use crate::report::scenario::Method;

    /// Runs that measured losses at such steps; `true` right after a training. The marginals are 1 higher.
    fn group(runs: &[&[(u64, bool, f64)]]) -> Group {
        let run = |losses: &&[(u64, bool, f64)]| RunRecord {
            dir: Default::default(),
            config: toml::from_str("[warehouse]\nagents_per_side = 2").unwrap(),
            about: Default::default(),
            evaluations: Vec::new(),
            aip_trainings: Vec::new(),
            fresh_losses: losses
                .iter()
                .map(|&(steps, after_training, loss)| FreshLoss { steps, after_training, loss, marginals: loss + 1.0 })
                .collect(),
            periods: Vec::new(),
            memory: None,
            workers: 1,
        };
        let runs: Vec<RunRecord> = runs.iter().map(run).collect();
        Group { method: Method::of(&runs[0].config), overrides: Vec::new(), runs }
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
        // At 100 the second run is half way from 4 to 8; the third one has not come so far.
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
