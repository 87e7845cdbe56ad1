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
    let mut agents = run.begin(fleet)?; // 1: policies and AIPs, fresh or as a checkpoint left them
    for period in schedule(config).iter().skip(run.periods_done()) {
        // 2: repeat
        if period.evaluate {
            run.evaluated(agents.steps, &fleet.evaluate(&agents.policies)?)?;
        }
        if period.retrain_aips {
            let datasets = fleet.collect_datasets(&agents.policies, period)?; // 3
            run.aips_trained(agents.steps, &fleet.train_aips(datasets, period)?)?; // 4-6: in parallel, for every agent
        }
        let training = fleet.train_policies(period)?; // 7-12: in parallel, for every agent, F steps
        agents = fleet.state()?;
        run.period_done(&training, &agents, fleet.take_load())?;
    } // 13: until end of training
    run.evaluated(agents.steps, &fleet.evaluate(&agents.policies)?)?;
    run.finished(agents.steps, fleet.take_load())
}
