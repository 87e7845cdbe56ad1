//! Algorithm 1 of the paper: MARL with DIALS.

use crate::algorithms::averaging::average;
use crate::config::{Config, rest_of_schedule};
use crate::fleet::Fleet;
use crate::observer::Recorder;
use crate::observer::{Interrupted, Observer};
use crate::progress::{Moment, TrainingProgress};
use crate::steps::collect::{Purpose, collect_datasets};
use crate::steps::evaluate::evaluate;
use crate::steps::imitate::{collect_demonstrations, imitate};
use crate::steps::train_aips::{measure_aips, train_aips};
use crate::steps::train_policies::train_policies;
use dials_core::domain::Result;

/// Trains the policies of all agents as the config says, from their current state.
///
/// The numbers are the lines of Algorithm 1. Training on the GS and with untrained AIPs is the same loop without lines
/// 3 to 6. With marginals, lines 4 to 6 measure them instead of training AIPs.
pub fn train(
    config: &Config,
    fleet: &mut impl Fleet,
    progress: TrainingProgress,
    recorder: &mut dyn Recorder,
    observer: &dyn Observer,
) -> Result<()> {
    let kinds = &fleet.domain().kinds().clone();
    let mut run = Training { config, fleet, progress, recorder, observer };
    run.recorder.begun(run.fleet.agents())?; // 1: policies and AIPs, new or from a checkpoint
    run.imitate_at_the_beginning()?; // if the config names a controller; not in the paper
    for period in &rest_of_schedule(config, progress.until) {
        // 2: repeat
        if period.evaluate && run.progress.evaluated_at != Some(run.fleet.agents().steps) {
            run.evaluate(config.evaluation.episodes)?;
        }
        if run.progress.trains_aips(period, config) {
            let datasets = collect_datasets(run.fleet, Purpose::Training { steps: period.start })?; // 3
            let losses = train_aips(run.fleet, datasets, period)?; // 4-6: in parallel, for every agent
            run.recorder.aips_trained(run.fleet.agents(), &losses)?;
            observer.aips_trained(run.fleet.agents().steps, &losses);
            run.measure_aips(Moment::Training)?;
        }
        if run.fleet.agents().steps >= period.end {
            continue; // The last update has already passed this period.
        }
        let training = train_policies(run.fleet, period)?; // 7-12: in parallel, for every agent, F steps
        run.progress.until = period.end;
        if period.average {
            run.fleet.change(|agents| average(agents, config, kinds))?; // if the config asks for it; not in the paper
        }
        let load = run.fleet.take_load();
        run.recorder.period_done(run.fleet.agents(), &run.progress, &training, load)?;
        if observer.stop_requested() {
            return Err(Interrupted.into()); // Nothing is lost here.
        }
    } // 13: until end of training
    run.evaluate(config.evaluation.final_episodes)?;
    let load = run.fleet.take_load();
    run.recorder.finished(run.fleet.agents(), load)
}

/// Algorithm 1 in progress.
struct Training<'a, F> {
    config: &'a Config,
    fleet: &'a mut F,
    progress: TrainingProgress,
    recorder: &'a mut dyn Recorder,
    observer: &'a dyn Observer,
}

impl<F: Fleet> Training<'_, F> {
    /// Makes new policies imitate the controller that the config names, if it names one.
    fn imitate_at_the_beginning(&mut self) -> Result<()> {
        let (0, Some(controller)) = (self.progress.until, &self.config.policy.imitate) else { return Ok(()) };
        let demonstrations = collect_demonstrations(self.fleet, controller)?;
        let losses = imitate(self.fleet, demonstrations)?;
        self.recorder.imitated(self.fleet.agents(), &losses)?;
        self.observer.imitated(controller, &losses);
        Ok(())
    }

    /// Evaluates the joint policy on the first `episodes` evaluation episodes, and the AIPs if the config asks for it.
    fn evaluate(&mut self, episodes: usize) -> Result<()> {
        let evaluation = evaluate(self.fleet, episodes)?;
        self.recorder.evaluated(self.fleet.agents(), &evaluation)?;
        self.progress.evaluated_at = Some(self.fleet.agents().steps);
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
        self.recorder.aips_measured(self.fleet.agents(), after, &losses)?;
        self.progress.drift.note(after, &losses);
        self.observer.aips_measured(&losses, &self.progress.drift);
        Ok(())
    }
}
