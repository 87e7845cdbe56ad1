//! Algorithm 1 of the paper: MARL with DIALS.

use super::collect::Purpose;
use super::drift::Moment;
use super::fleet::Fleet;
use super::run_log::RunLog;
use crate::config::{AipTraining, Config, schedule};
use crate::domain::Result;

/// Trains the policies of all agents as the config says and writes the run down as it goes.
///
/// The numbers are the lines of Algorithm 1. Training on the GS and with untrained AIPs is the same loop without
/// lines 3 to 6; with marginals, lines 4 to 6 measure them instead of training AIPs.
pub fn train(config: &Config, fleet: &mut dyn Fleet, run: &mut RunLog) -> Result<()> {
    run.begin(fleet)?; // 1: policies and AIPs, fresh or as a checkpoint left them
    for period in schedule(config).iter().skip(run.periods_done()) {
        // 2: repeat
        if period.evaluate {
            evaluate(config.evaluation.episodes, config, fleet, run)?;
        }
        let train_aips = match period.train_aips {
            AipTraining::No => false,
            AipTraining::Yes => true,
            AipTraining::IfDrifted => run.drift().percent() > config.aip.drift_threshold,
        };
        if train_aips {
            let datasets = fleet.collect_datasets(Purpose::Training { steps: period.start })?; // 3
            let losses = fleet.train_aips(datasets, period)?; // 4-6: in parallel, for every agent
            run.aips_trained(fleet, &losses)?;
            measure_aips(config, fleet, run, Moment::Training)?;
        }
        let training = fleet.train_policies(period)?; // 7-12: in parallel, for every agent, F steps
        run.period_done(fleet, &training)?;
    } // 13: until end of training
    evaluate(config.evaluation.final_episodes, config, fleet, run)?;
    run.finished(fleet)
}

/// Evaluates the joint policy on the first `episodes` evaluation episodes, and the AIPs if the config asks for it.
fn evaluate(episodes: usize, config: &Config, fleet: &mut dyn Fleet, run: &mut RunLog) -> Result<()> {
    let evaluation = fleet.evaluate(episodes)?;
    run.evaluated(fleet, &evaluation)?;
    measure_aips(config, fleet, run, Moment::Evaluation)
}

/// Measures the loss of the AIPs on fresh episodes of the GS under the joint policy, where the config asks for it.
fn measure_aips(config: &Config, fleet: &mut dyn Fleet, run: &mut RunLog, after: Moment) -> Result<()> {
    if !config.measures_aips() {
        return Ok(());
    }
    let datasets = fleet.collect_datasets(Purpose::Measuring)?;
    let losses = fleet.measure_aips(datasets)?;
    run.aips_measured(fleet, after, &losses)
}
