//! The periods of a run: what Algorithm 1 does between two exchanges.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::{Config, SimulatorKind};

/// A stretch of training without messages, and what comes before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Period {
    pub index: usize,
    /// Timesteps per agent at which it begins and ends.
    pub start: u64,
    pub end: u64,
    /// Collect datasets and train the AIPs first.
    pub retrain_aips: bool,
    /// Evaluate the joint policy first.
    pub evaluate: bool,
}

/// All periods of a run, in order.
pub fn schedule(config: &Config) -> Vec<Period> {
    let last = config.last_step();
    let evaluate_every = config.evaluation.every_steps;
    let retrain_every = match config.simulator {
        SimulatorKind::Dials | SimulatorKind::MarginalDials => Some(config.aip.retrain_every_steps),
        SimulatorKind::Gs | SimulatorKind::UntrainedDials => None,
    };
    let mut bounds: BTreeSet<u64> = (0..last).step_by(evaluate_every as usize).collect();
    bounds.extend(retrain_every.iter().flat_map(|&every| (0..last).step_by(every as usize)));
    bounds.insert(last);
    let bounds: Vec<u64> = bounds.into_iter().collect();
    let periods = bounds.windows(2).enumerate().map(|(index, bound)| Period {
        index,
        start: bound[0],
        end: bound[1],
        retrain_aips: retrain_every.is_some_and(|every| bound[0].is_multiple_of(every)),
        evaluate: bound[0].is_multiple_of(evaluate_every),
    });
    periods.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(simulator: &str, total: u64, retrain: u64, evaluate: u64) -> Config {
        toml::from_str(&format!(
            "simulator = '{simulator}'\ntotal_steps = {total}\n\
             aip.retrain_every_steps = {retrain}\nevaluation.every_steps = {evaluate}\n\
             [traffic]\nnetwork = 'n'\nlocal_network = 'l'"
        ))
        .unwrap()
    }

    fn bounds(config: &Config) -> Vec<(u64, u64, bool, bool)> {
        schedule(config).iter().map(|p| (p.start, p.end, p.retrain_aips, p.evaluate)).collect()
    }

    #[test]
    fn periods_end_where_aips_are_retrained_or_policies_evaluated() {
        assert_eq!(
            bounds(&config("dials", 250, 100, 60)),
            [
                (0, 60, true, true),
                (60, 100, false, true),
                (100, 120, true, false),
                (120, 180, false, true),
                (180, 200, false, true),
                (200, 240, true, false),
                (240, 250, false, true),
            ]
        );
    }

    #[test]
    fn marginals_are_measured_when_aips_would_be_trained() {
        assert_eq!(bounds(&config("marginal-dials", 250, 100, 60)), bounds(&config("dials", 250, 100, 60)));
    }

    #[test]
    fn without_trained_aips_only_evaluations_cut() {
        for simulator in ["gs", "untrained-dials"] {
            assert_eq!(bounds(&config(simulator, 100, 10, 50)), [(0, 50, false, true), (50, 100, false, true)]);
        }
    }

    #[test]
    fn a_run_that_stops_early_keeps_its_schedule_up_to_there() {
        let mut config = config("dials", 1000, 1000, 100);
        config.stop_at_steps = Some(150);
        assert_eq!(bounds(&config), [(0, 100, true, true), (100, 150, false, true)]);
    }
}
