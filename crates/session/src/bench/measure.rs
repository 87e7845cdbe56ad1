//! Orders to a fleet, timed: as many of each kind as fit into a share of the time.

use std::time::{Duration, Instant};

use super::floor::{aip_trainings_flops, gradient_steps};
use super::marginals::predict_marginals;
use crate::config::RunConfig;
use dials_core::base::{Activity, Phase, Stopwatch};
use dials_core::domain::{Kinds, Result, RoughCosts};
use dials_learn::algorithms;
use dials_learn::config::{AipTraining, Period, Simulator};
use dials_learn::fleet::{Fleet, FleetLoad};
use dials_learn::observer::Recorder;
use dials_learn::predictors::Dataset;
use dials_learn::progress::TrainingProgress;
use dials_learn::steps::collect::{Purpose, collect_datasets};
use dials_learn::steps::evaluate::evaluate;
use dials_learn::steps::train_aips::train_aips;
use dials_learn::steps::train_policies::train_policies;

/// Shares of the time. The rest is for the start of processes and for a first guess of the speed.
const EVALUATION: f64 = 0.1;
const COLLECTION: f64 = 0.15;
const AIP_TRAINING: f64 = 0.15;
const TRAINING: f64 = 0.5;
/// Guess of the time in which the processes of a fleet start and load their simulators.
const START: Duration = Duration::from_secs(1);
/// Number of passes over a dataset: few, but enough that the losses before and after them cost little in comparison.
const AIP_EPOCHS: usize = 8;
/// Guess of the speed of AIP trainings, as a share of the peak. It only decides how long they are measured.
const OF_PEAK: f64 = 0.4;

/// Returns a config with which every order to a fleet of N workers is short, and each worker has a share of it.
pub fn short_orders(config: &RunConfig, workers: usize) -> RunConfig {
    let mut short = config.clone();
    short.learning.evaluation.episodes = workers;
    short.learning.evaluation.final_episodes = workers;
    short.learning.aip.dataset_steps = workers * config.horizon();
    short.learning.aip.first_dataset_share = 1.0;
    short.learning.aip.epochs = config.learning.aip.epochs.min(AIP_EPOCHS);
    short
}

/// Returns about how long a measurement takes. Each kind of order is given once at least: it may exceed `time`.
pub fn expected(config: &RunConfig, agents: usize, rough: &RoughCosts, workers: usize, time: Duration) -> Duration {
    let part = |share: f64, least_s: f64| time.mul_f64(share).max(Duration::from_secs_f64(least_s));
    // Each worker plays whole episodes.
    let episode_s = (agents * config.horizon()) as f64 * rough.evaluation_s;
    let dataset_s = episode_s * config.learning.dataset_episodes(config.horizon()).div_ceil(workers) as f64;
    let step_s = if config.learning.simulator == Simulator::Global { rough.training_on_gs_s } else { rough.training_s };
    let update_s = (agents * algorithms::of(&config.learning).steps_per_update()) as f64 * step_s / workers as f64;
    let of_predictors = match config.learning.trains_predictors() {
        true => part(COLLECTION, dataset_s) + part(AIP_TRAINING, 0.0),
        false => Duration::ZERO,
    };
    // One update more shows how long one takes.
    START + part(EVALUATION, episode_s) + of_predictors + part(TRAINING, 2.0 * update_s) + part(0.0, update_s)
}

/// Times of the orders of one kind, added up.
#[derive(Clone, Debug, Default)]
pub(crate) struct Orders {
    pub(crate) count: usize,
    /// Amount of work, in the unit of the activity: see [`Measured`].
    pub(crate) units: f64,
    /// Wall time from the order to the last answer, including the files that a run then writes.
    pub(crate) wall: Duration,
    /// Time of the slowest worker of each order, without its beginning: [`Orders::BEGINNING`].
    pub(crate) slowest: Duration,
    /// Time of work, added up over the workers.
    pub(crate) work: Duration,
    pub(crate) phases: Stopwatch,
}

/// Measurements of a fleet. An activity that the config does not use has no orders.
#[derive(Clone, Debug)]
pub struct Measured {
    pub(crate) workers: usize,
    /// Units: timesteps of agents.
    pub(crate) training: Orders,
    /// Units: episodes of each worker.
    pub(crate) evaluation: Orders,
    /// Units: episodes of each worker.
    pub(crate) collection: Orders,
    /// Units: floating-point operations in matrix products.
    pub(crate) aip_training: Orders,
    /// Memory of all processes together, in KiB, shared pages counted once: the maximum after any order.
    pub(crate) pss_kib: u64,
    /// Peak resident memory of a single process, in KiB.
    pub(crate) peak_rss_kib: u64,
}

impl Measured {
    /// Returns the part of an episode that every local simulator, or the GS, played while the policies trained.
    pub fn share_of_an_episode(&self, config: &RunConfig, agents: usize) -> f64 {
        self.training.units / (agents * config.learning.copies() * config.training_horizon()) as f64
    }
}

pub struct MeasurePlan<'a> {
    /// Config that [`short_orders`] made.
    pub config: &'a RunConfig,
    pub kinds: &'a Kinds,
    pub workers: usize,
    pub time: Duration,
    /// Peak speed of matrix products, in operations per second.
    pub peak_flops: f64,
}

/// Gives orders of every kind to `fleet`, which was made for `plan.config`.
pub fn measure<F: Fleet>(plan: &MeasurePlan<'_>, fleet: &mut F, journal: &mut dyn Recorder) -> Result<Measured> {
    let (learning, kinds) = (&plan.config.learning, plan.kinds);
    let agents = fleet.agents().agents();
    let part = |share: f64| plan.time.mul_f64(share);

    let evaluation = repeat(part(EVALUATION), Activity::Evaluation, 1.0, |_| {
        let begun = Instant::now();
        let evaluation = evaluate(fleet, learning.evaluation.episodes)?;
        let load = fleet.take_load();
        journal.evaluated(fleet.agents(), &evaluation)?;
        Ok((begun.elapsed(), load))
    })?;
    let mut period = Period { start: 0, end: 0, train_aips: AipTraining::No, evaluate: false, average: false };
    let (mut collection, mut aip_training) = (Orders::default(), Orders::default());
    if learning.trains_predictors() {
        // A single worker plays two episodes, because one of a dataset is held out.
        let rounds = learning.dataset_episodes(kinds.horizon()) as f64 / plan.workers as f64;
        let (mut last, mut seen) = (Vec::new(), Dataset::of_all(kinds));
        collection = repeat(part(COLLECTION), Activity::Collection, rounds, |order| {
            let begun = Instant::now();
            // Different episodes each time: the traffic of one varies by several percent, and the marginals come from them.
            last = collect_datasets(fleet, Purpose::Training { steps: order })?;
            let (load, wall) = (fleet.take_load(), begun.elapsed());
            seen.iter_mut().zip(&last).for_each(|(seen, dataset)| seen.extend(dataset));
            Ok((wall, load))
        })?;
        let flops = part(AIP_TRAINING).as_secs_f64() * plan.peak_flops * OF_PEAK * plan.workers as f64;
        let enough = episodes_for(plan, flops);
        let datasets: Vec<Dataset> = last.iter().map(|dataset| repeated(dataset, enough)).collect();
        let flops = aip_trainings_flops(plan.config, kinds, datasets[0].episodes());
        aip_training = repeat(part(AIP_TRAINING), Activity::AipTraining, flops, |_| {
            let datasets = datasets.clone();
            let begun = Instant::now();
            let losses = train_aips(fleet, datasets, &period)?;
            let load = fleet.take_load();
            journal.aips_trained(fleet.agents(), &losses)?;
            Ok((begun.elapsed(), load))
        })?;
        let mut state = fleet.agents().clone();
        for (agent, (spec, seen)) in kinds.specs().zip(&seen).enumerate() {
            predict_marginals(state.aips.row_mut(agent), spec, &learning.aip, seen);
        }
        fleet.restore(state)?;
    }
    let mut standing = TrainingProgress::default();
    let mut train = |fleet: &mut F, steps: u64| {
        period.end = steps;
        repeat(Duration::ZERO, Activity::Training, steps as f64 * agents as f64, |_| {
            let begun = Instant::now();
            let training = train_policies(fleet, &period, None)?;
            let load = fleet.take_load();
            standing.until = period.end;
            journal.period_done(fleet.agents(), &standing, &training, load.clone())?;
            Ok((begun.elapsed(), load))
        })
    };
    // The first update only shows how long one takes. The measurement starts again where it did.
    let memory = algorithms::of(learning).steps_per_update() as u64;
    let beginning = fleet.agents().clone();
    let guess = train(fleet, memory)?;
    fleet.restore(beginning)?;
    let updates = part(TRAINING).div_duration_f64(guess.slowest.max(Duration::from_millis(1)));
    let training = train(fleet, memory * (updates as u64).max(2))?;

    let load = fleet.take_load();
    let processes = || load.workers.iter().map(|worker| worker.footprint).chain(load.coordinator);
    Ok(Measured {
        workers: plan.workers,
        training,
        evaluation,
        collection,
        aip_training,
        pss_kib: processes().map(|process| process.pss_kib).sum(),
        peak_rss_kib: processes().map(|process| process.peak_rss_kib).max().unwrap_or(0),
    })
}

/// Gives orders until the time is over, at least one. `give`: gives the N-th; returns its wall time and load.
fn repeat(
    time: Duration,
    activity: Activity,
    units: f64,
    mut give: impl FnMut(u64) -> Result<(Duration, FleetLoad)>,
) -> Result<Orders> {
    let mut orders = Orders::default();
    while orders.count == 0 || orders.wall < time {
        let (wall, load) = give(orders.count as u64)?;
        orders.note(activity, units, wall, &load);
    }
    Ok(orders)
}

/// Returns the episodes per dataset with which AIP trainings take about `flops` operations: enough for a gradient step.
fn episodes_for(plan: &MeasurePlan<'_>, flops: f64) -> usize {
    let horizon = plan.kinds.horizon();
    let whole = plan.config.learning.dataset_episodes(horizon);
    let mut episodes = 2;
    let too_few = |episodes| gradient_steps(plan.config, horizon, episodes) == 0;
    while too_few(episodes) || (episodes < whole && aip_trainings_flops(plan.config, plan.kinds, episodes) < flops) {
        episodes += 1;
    }
    episodes
}

fn repeated(dataset: &Dataset, episodes: usize) -> Dataset {
    let mut longer = dataset.clone();
    while longer.episodes() < episodes {
        longer.extend(dataset);
    }
    longer
}

impl Orders {
    /// Phases in which simulators are made and brought to the state of training. They do not grow with the work.
    pub(crate) const BEGINNING: [Phase; 2] = [Phase::Loading, Phase::Retracing];

    fn note(&mut self, activity: Activity, units: f64, wall: Duration, load: &FleetLoad) {
        self.count += 1;
        self.units += units;
        self.wall += wall;
        let of_workers = || load.workers.iter().map(|worker| &worker.timesheet);
        let net = of_workers().map(|sheet| sheet.whole(activity).saturating_sub(beginning(sheet.phases(activity))));
        self.slowest += net.max().unwrap_or_default();
        for sheet in of_workers() {
            self.work += sheet.whole(activity);
            self.phases.add(sheet.phases(activity));
        }
    }
}

pub(super) fn beginning(phases: &Stopwatch) -> Duration {
    Orders::BEGINNING.iter().map(|&phase| phases.spent(phase)).sum()
}
