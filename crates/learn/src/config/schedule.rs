//! The periods of a run: the work of Algorithm 1 between two exchanges.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::{Config, Retrain};

/// A stretch of training without messages, and what is done before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Period {
    /// Timesteps per agent at which it begins and ends.
    pub start: u64,
    pub end: u64,
    /// Whether to evaluate the joint policy first.
    pub evaluate: bool,
    /// Whether to then collect datasets and train the AIPs.
    pub train_aips: AipTraining,
    /// Whether the agents of a kind get the mean of their policies at its end.
    pub average: bool,
}

/// Whether a period begins with a training of the AIPs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum AipTraining {
    No,
    Yes,
    /// Only if the evaluation finds that their loss has grown.
    IfDrifted,
}

/// Returns all periods of a run, in order. The last one trains.
///
/// The policies are updated after every `ppo.memory` timesteps, so a period ends at the first update at or after its
/// end. The last one ends at the first bound that the last update reaches. What is due there is left to a run that goes
/// on: a run that ends evaluates anyway.
pub fn schedule(config: &Config) -> Vec<Period> {
    let evaluate_every = config.evaluation.every_steps;
    let trains_aips = config.trains_predictors();
    let update = |step| config.update_at_or_after(step);
    let mut bounds: Vec<u64> = all_bounds(config).into_iter().collect();
    let reached = bounds.iter().position(|&bound| update(bound) >= config.end());
    bounds.truncate(reached.expect("the last step is one of them") + 1);
    // An evaluation comes before all else that is due at the same update, also if its multiple is larger.
    let evaluates = |start: u64| update(start.next_multiple_of(evaluate_every)) == update(start);
    let train_aips = |start: u64| match config.aip.retrain {
        _ if !trains_aips => AipTraining::No,
        _ if start == 0 => AipTraining::Yes,
        Retrain::Every if start.is_multiple_of(config.aip.retrain_every_steps) => AipTraining::Yes,
        Retrain::Drift if start.is_multiple_of(evaluate_every) => AipTraining::IfDrifted,
        Retrain::Every | Retrain::Once | Retrain::Drift => AipTraining::No,
    };
    // Averages are due at the first update at or after each multiple, wherever the periods end.
    let averages = |start: u64, end: u64| {
        let [start, end, last] = [start, end, config.total_steps].map(update);
        config.policy.average_every_steps.is_some_and(|every| end / every > start / every || end == last)
    };
    let periods = bounds.windows(2).map(|bound| Period {
        start: bound[0],
        end: bound[1],
        evaluate: evaluates(bound[0]),
        train_aips: train_aips(bound[0]),
        average: averages(bound[0], bound[1]),
    });
    periods.collect()
}

/// Returns all steps at which something is due, with the beginning and the end of the run.
fn all_bounds(config: &Config) -> BTreeSet<u64> {
    let last = config.last_step();
    let evaluates_every = [config.evaluation.every_steps];
    let trains_aips = config.trains_predictors() && config.aip.retrain == Retrain::Every;
    let retrains_every = trains_aips.then_some(config.aip.retrain_every_steps);
    let others = [config.checkpoints.every_steps, config.policy.average_every_steps];
    let rhythms = evaluates_every.into_iter().chain(retrains_every).chain(others.into_iter().flatten());
    let mut bounds: BTreeSet<u64> = rhythms.flat_map(|every| (0..last).step_by(every as usize)).collect();
    bounds.insert(last);
    bounds
}

/// Returns the periods that remain when training has come to the end of a period, `until`.
///
/// The schedule may have changed since then, so that `until` lies within a period. Then only the rest of this period is
/// trained: what is done before a period belongs to its start. If nothing is left to train in it, it is left out.
pub fn rest_of_schedule(config: &Config, until: u64) -> Vec<Period> {
    let mut rest = schedule(config);
    rest.retain(|period| period.start >= until || trains(config, until, period.end));
    if let Some(first) = rest.first_mut().filter(|first| first.start < until) {
        *first = Period { start: until, evaluate: false, train_aips: AipTraining::No, ..*first };
    }
    rest
}

/// Returns whether there is an update of the policies between two bounds of periods.
fn trains(config: &Config, start: u64, end: u64) -> bool {
    config.update_at_or_after(start) < end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Predictor;

    fn config(total: u64, retrain: u64, evaluate: u64) -> Config {
        let mut config = Config { total_steps: total, ..Config::default() };
        (config.aip.retrain_every_steps, config.evaluation.every_steps, config.ppo.memory) = (retrain, evaluate, 10);
        config
    }

    #[test]
    fn policies_are_evaluated_before_aips_are_trained_at_the_same_update() {
        let mut config = config(400, 65, 70);
        config.ppo.memory = 64;
        // 65 and 70 are both at the update at 128, and 130 and 140 at 192. So are 195 and 210 at 256, 260 and 280 at 320.
        let due = work(&config, &schedule(&config));
        let first = [0, 128, 192, 256, 320].map(|at| due.iter().find(|work| work.0 == at).unwrap());
        assert!(first.iter().all(|work| work.1 == "evaluates"), "{due:?}");
    }

    /// Returns the updates, in timesteps, after which policies are averaged.
    fn averages(config: &Config) -> Vec<u64> {
        let averaging = schedule(config).into_iter().filter(|period| period.average);
        averaging.map(|period| config.update_at_or_after(period.end)).collect()
    }

    #[test]
    fn policies_are_averaged_at_the_same_updates_wherever_else_a_run_is_cut() {
        for (memory, every, expected) in [
            (10, 100, vec![100, 200, 250]),
            (10, 50, vec![50, 100, 150, 200, 250]),
            // Updates are at 64, 128, 192 and 256, which is the last one.
            (64, 100, vec![128, 256]),
            (64, 65, vec![128, 192, 256]),
            (64, 1000, vec![256]),
        ] {
            let mut config = config(250, 1000, 1000);
            (config.ppo.memory, config.policy.average_every_steps) = (memory, Some(every));
            assert_eq!(averages(&config), expected, "every {every} with a memory of {memory}");
            for rhythm in [64, 90, 120] {
                config.evaluation.every_steps = rhythm;
                assert_eq!(averages(&config), expected, "every {every}, evaluated every {rhythm}");
            }
        }
        assert!(averages(&config(250, 100, 60)).is_empty());
    }

    /// Returns what a run does, each after which update in timesteps.
    fn work(config: &Config, periods: &[Period]) -> Vec<(u64, &'static str)> {
        let update = |step| config.update_at_or_after(step);
        let of_period = |period: &Period| {
            let evaluates = period.evaluate.then(|| (update(period.start), "evaluates"));
            let trains = (period.train_aips != AipTraining::No).then(|| (update(period.start), "trains AIPs"));
            [evaluates, trains, period.average.then(|| (update(period.end), "averages"))].into_iter().flatten()
        };
        periods.iter().flat_map(of_period).collect()
    }

    #[test]
    fn a_run_that_was_stopped_anywhere_does_the_work_of_one_that_never_was() {
        for (memory, retrain, evaluate) in [(10, 100, 60), (64, 100, 60), (64, 60, 100), (128, 75, 90)] {
            let mut config = config(500, retrain, evaluate);
            (config.ppo.memory, config.policy.average_every_steps) = (memory, Some(130));
            let whole = work(&config, &schedule(&config));
            for stop in 1..500 {
                let stopped = schedule(&Config { stop_at_steps: Some(stop), ..config.clone() });
                let rest = rest_of_schedule(&config, stopped.last().unwrap().end);
                let both = [work(&config, &stopped), work(&config, &rest)].concat();
                assert_eq!(both, whole, "F = {retrain}, a memory of {memory}, stopped at {stop}");
            }
        }
    }

    #[test]
    fn aips_of_one_training_or_on_drift_are_trained_first_and_checkpoints_begin_periods_without_any() {
        let no = AipTraining::No;
        for (retrain, later) in [(Retrain::Once, no), (Retrain::Drift, AipTraining::IfDrifted)] {
            let mut config = config(100, 60, 50);
            (config.aip.retrain, config.checkpoints.every_steps) = (retrain, Some(40));
            let begin: Vec<_> = schedule(&config).iter().map(|p| (p.start, p.evaluate, p.train_aips)).collect();
            assert_eq!(begin, [(0, true, AipTraining::Yes), (40, false, no), (50, true, later), (80, false, no)]);
            config.predictor = Predictor::Untrained;
            assert!(schedule(&config).iter().all(|p| p.train_aips == no));
        }
    }
}
