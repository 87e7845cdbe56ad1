//! Algorithm 1 of the paper: MARL with DIALS.

use crate::algorithms::averaging::average;
use crate::config::{Config, rest_of_schedule};
use crate::fleet::Fleet;
use crate::observer::{Interrupted, Observer};
use crate::progress::Standing;
use crate::steps::collect::collect_datasets;
use crate::steps::demonstrate::collect_demonstrations;
use crate::steps::evaluate::evaluate;
use crate::steps::imitate::imitate;
use crate::steps::measure_aips::measure_aips;
use crate::steps::train_aips::train_aips;
use crate::steps::train_policies::train_policies;
use crate::training::collect::Purpose;
use crate::training::drift::Moment;
use crate::training::journal::Journal;
use dials_core::domain::Result;

/// Trains the policies of all agents as the config says, from their current state.
///
/// The numbers are the lines of Algorithm 1. Training on the GS (global simulator) and with untrained AIPs (approximate
/// influence predictors) is the same loop without lines 3 to 6. With marginals, lines 4 to 6 measure them instead of
/// training AIPs.
pub fn train(
    config: &Config,
    fleet: &mut impl Fleet,
    standing: Standing,
    journal: &mut dyn Journal,
    observer: &dyn Observer,
) -> Result<()> {
    let kinds = &fleet.domain().kinds().clone();
    let mut run = Training { config, fleet, standing, journal, observer };
    run.journal.begun(run.fleet.agents())?; // 1: policies and AIPs, new or from a checkpoint
    run.imitate_at_the_beginning()?; // if the config names a controller; not in the paper
    for period in &rest_of_schedule(config, standing.until) {
        // 2: repeat
        if period.evaluate && run.standing.evaluated_at != Some(run.fleet.agents().steps) {
            run.evaluate(config.evaluation.episodes)?;
        }
        if run.standing.trains_aips(period, config) {
            let datasets = collect_datasets(run.fleet, Purpose::Training { steps: period.start })?; // 3
            let losses = train_aips(run.fleet, datasets, period)?; // 4-6: in parallel, for every agent
            run.journal.aips_trained(run.fleet.agents(), &losses)?;
            observer.aips_trained(run.fleet.agents().steps, &losses);
            run.measure_aips(Moment::Training)?;
        }
        if run.fleet.agents().steps >= period.end {
            continue; // The last update has already passed this period.
        }
        let training = train_policies(run.fleet, period)?; // 7-12: in parallel, for every agent, F steps
        run.standing.until = period.end;
        if period.average {
            run.fleet.change(|agents| average(agents, config, kinds))?; // if the config asks for it; not in the paper
        }
        let load = run.fleet.take_load();
        run.journal.period_done(run.fleet.agents(), &run.standing, &training, load)?;
        if observer.stop_requested() {
            return Err(Interrupted.into()); // Nothing is lost here.
        }
    } // 13: until end of training
    run.evaluate(config.evaluation.final_episodes)?;
    let load = run.fleet.take_load();
    run.journal.finished(run.fleet.agents(), load)
}

/// Algorithm 1 in progress.
struct Training<'a, F> {
    config: &'a Config,
    fleet: &'a mut F,
    standing: Standing,
    journal: &'a mut dyn Journal,
    observer: &'a dyn Observer,
}

impl<F: Fleet> Training<'_, F> {
    /// Makes new policies imitate the controller that the config names, if it names one.
    fn imitate_at_the_beginning(&mut self) -> Result<()> {
        let (0, Some(controller)) = (self.standing.until, &self.config.policy.imitate) else { return Ok(()) };
        let demonstrations = collect_demonstrations(self.fleet, controller)?;
        let losses = imitate(self.fleet, demonstrations)?;
        self.journal.imitated(self.fleet.agents(), &losses)?;
        self.observer.imitated(controller, &losses);
        Ok(())
    }

    /// Evaluates the joint policy on the first `episodes` evaluation episodes, and the AIPs if the config asks for it.
    fn evaluate(&mut self, episodes: usize) -> Result<()> {
        let evaluation = evaluate(self.fleet, episodes)?;
        self.journal.evaluated(self.fleet.agents(), &evaluation)?;
        self.standing.evaluated_at = Some(self.fleet.agents().steps);
        self.observer.evaluated(self.fleet.agents().steps, &evaluation);
        self.measure_aips(Moment::Evaluation)
    }

    /// Measures the loss of the AIPs on new episodes of the GS under the joint policy, if the config asks for it.
    fn measure_aips(&mut self, after: Moment) -> Result<()> {
        if !self.config.measures_aips() {
            return Ok(());
        }
        let datasets = collect_datasets(self.fleet, Purpose::Measuring)?;
        let losses = measure_aips(self.fleet, datasets)?;
        self.journal.aips_measured(self.fleet.agents(), after, &losses)?;
        self.standing.drift.note(after, &losses);
        self.observer.aips_measured(&losses, &self.standing.drift);
        Ok(())
    }
}
