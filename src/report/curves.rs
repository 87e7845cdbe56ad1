//! Learning curves: what the runs of a group say together, step by step.
//!
//! Runs of unequal length: a curve has a point at every step at which some run of the group was evaluated. A run counts
//! at a point if it has come so far, interpolated on a straight line between two of its evaluations, and is never
//! prolonged beyond its last one. A point tells how many runs it stands for.

use std::collections::{BTreeMap, BTreeSet};

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

/// The cross-entropy of a group's AIPs, on fresh GS episodes where its runs measured that. Only points that all runs have
/// which have any count.
pub fn loss_curve(group: &Group) -> (LossData, Vec<LossPoint>) {
    let fresh = group.runs.iter().any(|run| !run.fresh_losses.is_empty());
    let data = if fresh { LossData::Fresh } else { LossData::HeldOut };
    let of_runs: Vec<Measured> =
        group.runs.iter().map(|run| measured(run, data)).filter(|run| !run.is_empty()).collect();
    let places = of_runs.iter().map(|run| run.keys().copied().collect::<BTreeSet<_>>());
    let common = places.reduce(|common, places| &common & &places).unwrap_or_default();
    let points = common.into_iter().filter_map(|(steps, after_training)| {
        let here = || of_runs.iter().map(|run| run[&(steps, after_training)]);
        let loss = Spread::of(&here().map(|[loss, _]| loss).collect::<Vec<_>>())?;
        let marginals = mean(&here().map(|[_, marginals]| marginals).collect::<Vec<_>>());
        Some(LossPoint { steps, after_training, loss, marginals })
    });
    (data, points.collect())
}

/// Losses of a run and of its marginals, by steps and whether the AIPs have just been trained.
type Measured = BTreeMap<(u64, bool), [f64; 2]>;

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
