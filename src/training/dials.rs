//! Algorithm 1 of the paper: MARL with DIALS.

use super::fleet::Fleet;
use super::run_log::RunLog;
use crate::base::Phase;
use crate::config::{Config, schedule};
use crate::domain::Result;
use crate::policy::JointPolicy;

/// Trains the policies of all agents as the config says and writes the run down as it goes.
///
/// The numbers are the lines of Algorithm 1. Training on the GS and with untrained AIPs is the same loop without
/// lines 3 to 6.
pub fn train(config: &Config, fleet: &mut dyn Fleet, run: &mut RunLog) -> Result<JointPolicy> {
    let mut policies = fleet.initial_policies()?; // 1: policies and AIPs
    let mut steps = 0;
    for period in schedule(config) {
        // 2: repeat
        if period.evaluate {
            let evaluation = run.time(Phase::Evaluation, || fleet.evaluate(&policies))?;
            run.evaluated(steps, &evaluation)?;
        }
        if period.retrain_aips {
            let datasets = run.time(Phase::Collection, || fleet.collect_datasets(&policies, &period))?; // 3
            let training = fleet.train_aips(datasets, &period)?; // 4-6: in parallel, for every agent
            run.aips_trained(steps, &training)?;
        }
        let training = fleet.train_policies(&period)?; // 7-12: in parallel, for every agent, F steps
        run.policies_trained(&training)?;
        (steps, policies) = (training.steps, training.policies);
    } // 13: until end of training
    let evaluation = run.time(Phase::Evaluation, || fleet.evaluate(&policies))?;
    run.evaluated(steps, &evaluation)?;
    Ok(policies)
}
