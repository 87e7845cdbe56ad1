//! Algorithm 1 of the paper: MARL with DIALS.

use std::time::Instant;

use crate::algorithms::averaging::average;
use crate::config::{Config, Period, rest_of_schedule};
use crate::fleet::Fleet;
use crate::observer::Recorder;
use crate::observer::{Interrupted, Observer};
use crate::pace::Pace;
use crate::predictors::outside;
use crate::progress::{Moment, TrainingProgress};
use crate::steps::collect::{Purpose, collect_datasets};
use crate::steps::evaluate::evaluate;
use crate::steps::imitate::{collect_demonstrations, imitate};
use crate::steps::train_aips::{measure_aips, train_aips};
use crate::steps::train_policies::{PolicyTraining, train_policies};
use dials_core::base::Activity;
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
    let pace = Pace::guess(config, fleet.domain());
    let mut run = Training { config, fleet, progress, pace, recorder, observer };
    run.recorder.begun(run.fleet.agents())?; // 1: policies and AIPs, new or from a checkpoint
    if config.predicts_outside() {
        outside::load(&run.fleet.agents().outside_aips)?;
    }
    run.imitate_at_the_beginning()?; // if the config names a controller; not in the paper
    run.end_a_period_that_was_cut_here()?;
    for period in &rest_of_schedule(config, run.progress.until) {
        // 2: repeat
        if period.evaluate && run.progress.evaluated_at != Some(run.fleet.agents().steps) {
            run.evaluate(config.evaluation.episodes)?;
        }
        if run.progress.trains_aips(period, run.fleet.agents().steps, config) {
            let datasets = collect_datasets(run.fleet, Purpose::Training { steps: period.start })?; // 3
            observer.busy(Activity::AipTraining, 0.0);
            let losses = train_aips(run.fleet, datasets, period)?; // 4-6: in parallel, for every agent
            run.recorder.aips_trained(run.fleet.agents(), &losses)?;
            observer.aips_trained(run.fleet.agents().steps, &losses);
            run.measure_aips(Moment::Training)?;
            run.progress.aips_trained_at = Some(run.fleet.agents().steps);
        }
        if run.fleet.agents().steps >= period.end {
            continue; // The last update has already passed this period.
        }
        let training = run.train_policies(period)?; // 7-12: in parallel, for every agent, F steps
        if period.average {
            run.fleet.change(|agents| average(agents, config, kinds))?; // if the config asks for it; not in the paper
        }
        run.end_period(&training)?;
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
    pace: Pace,
    recorder: &'a mut dyn Recorder,
    observer: &'a dyn Observer,
}

impl<F: Fleet> Training<'_, F> {
    /// Makes new policies imitate the controller that the config names, if it names one.
    fn imitate_at_the_beginning(&mut self) -> Result<()> {
        let TrainingProgress { until: 0, evaluated_at: None, .. } = self.progress else { return Ok(()) };
        let Some(controller) = &self.config.policy.imitate else { return Ok(()) };
        let demonstrations = collect_demonstrations(self.fleet, controller)?;
        let losses = imitate(self.fleet, demonstrations)?;
        self.recorder.imitated(self.fleet.agents(), &losses)?;
        self.observer.imitated(controller, &losses);
        Ok(())
    }

    /// Trains the policies until the end of the period, with checkpoints if it takes long.
    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining> {
        let until = self.config.update_at_or_after(period.end);
        if self.pace.is_half_over() {
            self.save()?; // Evaluations and AIPs took long.
        }
        loop {
            let (steps, begun) = (self.fleet.agents().steps, Instant::now());
            let part = self.pace.next(period, steps, self.config);
            let training = train_policies(self.fleet, &part, self.progress.so_far.take())?;
            let now = self.fleet.agents().steps;
            self.pace.note(now - steps, begun.elapsed());
            self.progress.until = part.end;
            if now == until {
                return Ok(training);
            }
            self.progress.so_far = Some(training);
            self.save()?;
            self.stop_if_asked()?;
        }
    }

    /// Writes a checkpoint between two of its usual places.
    fn save(&mut self) -> Result<()> {
        self.recorder.saved(self.fleet.agents(), &self.progress)?;
        self.pace.saved();
        Ok(())
    }

    fn end_period(&mut self, training: &PolicyTraining) -> Result<()> {
        let load = self.fleet.take_load();
        self.recorder.period_done(self.fleet.agents(), &self.progress, training, load)?;
        self.pace.saved();
        self.stop_if_asked()
    }

    /// Ends a period that was cut here, if the schedule has changed since then and now has an end here.
    fn end_a_period_that_was_cut_here(&mut self) -> Result<()> {
        let ends_here = self.progress.ends_a_period(self.config);
        match self.progress.so_far.take_if(|_| ends_here) {
            Some(training) => self.end_period(&training),
            None => Ok(()),
        }
    }

    /// Returns an error if somebody asked to stop. Only right after a checkpoint, so that nothing is lost.
    fn stop_if_asked(&self) -> Result<()> {
        if self.observer.stop_requested() { Err(Interrupted.into()) } else { Ok(()) }
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
