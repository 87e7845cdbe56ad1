//! Algorithm 1 of the paper: MARL with DIALS.

use super::fleet::Fleet;
use super::run_log::RunLog;
use crate::config::{Config, schedule};
use crate::domain::Result;

/// Trains the policies of all agents as the config says and writes the run down as it goes.
///
/// The numbers are the lines of Algorithm 1. Training on the GS and with untrained AIPs is the same loop without
/// lines 3 to 6.
pub fn train(config: &Config, fleet: &mut dyn Fleet, run: &mut RunLog) -> Result<()> {
    run.begin(fleet)?; // 1: policies and AIPs, fresh or as a checkpoint left them
    for period in schedule(config).iter().skip(run.periods_done()) {
        // 2: repeat
        if period.evaluate {
            let evaluation = fleet.evaluate()?;
            run.evaluated(fleet, &evaluation)?;
        }
        if period.retrain_aips {
            let datasets = fleet.collect_datasets(period)?; // 3
            let losses = fleet.train_aips(datasets, period)?; // 4-6: in parallel, for every agent
            run.aips_trained(fleet, &losses)?;
        }
        let training = fleet.train_policies(period)?; // 7-12: in parallel, for every agent, F steps
        run.period_done(fleet, &training)?;
    } // 13: until end of training
    let evaluation = fleet.evaluate()?;
    run.evaluated(fleet, &evaluation)?;
    run.finished(fleet)
}
