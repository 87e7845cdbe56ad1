//! Learning curves: what the runs of a group say together, step by step.
//!
//! Runs of unequal length: a curve has a point at every step at which some run of the group was evaluated. A run counts
//! at a point if it has come so far, interpolated on a straight line between two of its evaluations, and is never
//! prolonged beyond its last one. A point tells how many runs it stands for.

use std::collections::BTreeSet;

use super::group::Group;
use super::run_dir::RunRecord;
use super::statistics::Spread;
use crate::base::statistics::mean;

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
    /// Whether AIPs are about to be trained here (`Some(false)`), have just been (`Some(true)`), or were only measured.
    pub trained: Option<bool>,
    /// Nats per source, over seeds.
    pub loss: Spread,
    /// Of constant marginals, mean over seeds.
    pub marginals: Option<f64>,
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

/// The cross-entropy of a group's AIPs: on fresh GS data where its runs measured that, else on the held-out episodes of
/// the datasets, before and after each training. Only steps that all runs with any such figures have reached count.
pub fn loss_curve(group: &Group) -> Vec<LossPoint> {
    if group.runs.iter().any(|run| !run.fresh_losses.is_empty()) {
        return common_steps(group, |run| run.fresh_losses.iter().map(|loss| loss.steps).collect())
            .into_iter()
            .filter_map(|steps| {
                let here = group.runs.iter().filter_map(|run| run.fresh_losses.iter().find(|loss| loss.steps == steps));
                let losses: Vec<(f64, Option<f64>)> = here.map(|loss| (loss.cross_entropy, loss.marginals)).collect();
                loss_point(steps, None, &losses)
            })
            .collect();
    }
    let steps = common_steps(group, |run| run.aip_trainings.iter().map(|training| training.steps).collect());
    let points = steps.into_iter().flat_map(|steps| {
        let here = || group.runs.iter().filter_map(move |run| run.aip_trainings.iter().find(|t| t.steps == steps));
        let before: Vec<(f64, Option<f64>)> =
            here().map(|training| (training.before, Some(training.marginals))).collect();
        let after: Vec<(f64, Option<f64>)> =
            here().map(|training| (training.after, Some(training.marginals))).collect();
        [loss_point(steps, Some(false), &before), loss_point(steps, Some(true), &after)]
    });
    points.flatten().collect()
}

/// The steps that all runs have which have any.
fn common_steps(group: &Group, steps: impl Fn(&RunRecord) -> BTreeSet<u64>) -> BTreeSet<u64> {
    let sets = group.runs.iter().map(steps).filter(|steps| !steps.is_empty());
    sets.reduce(|common, steps| &common & &steps).unwrap_or_default()
}

fn loss_point(steps: u64, trained: Option<bool>, losses: &[(f64, Option<f64>)]) -> Option<LossPoint> {
    let marginals: Vec<f64> = losses.iter().filter_map(|(_, marginals)| *marginals).collect();
    let values: Vec<f64> = losses.iter().map(|(loss, _)| *loss).collect();
    Some(LossPoint {
        steps,
        trained,
        loss: Spread::of(&values)?,
        marginals: (!marginals.is_empty()).then(|| mean(&marginals)),
    })
}
