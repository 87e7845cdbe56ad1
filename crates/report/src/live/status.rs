//! How far a run is, how fast it goes, when it will end, and what its AIPs know.

use std::fs;
use std::time::{Duration, SystemTime};

use dials_core::outside::Directory;
use dials_session::records::files;
use dials_session::records::run_record::{RunRecord, Status};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum State {
    /// A process is writing it.
    Running,
    Finished,
    /// It is not finished, and no process is writing it.
    Stopped,
}

pub(crate) struct RunStatus {
    pub(crate) state: State,
    /// Timesteps per agent at the end of the last period, where the last checkpoint is.
    pub(crate) steps: u64,
    /// Timesteps per agent now, if the run goes on at the speed of its last period.
    pub(crate) about_steps: u64,
    /// Timesteps per agent at which the run ends, as the terminal shows them: at the first update of the policies from its last step on.
    pub(crate) end: u64,
    /// Timesteps of all agents per second of the last period, with evaluations and AIPs; `None` before its end.
    pub(crate) agent_steps_per_s: Option<f64>,
    /// Time until the last step at this speed, for a run that goes on.
    pub(crate) left: Option<Duration>,
    /// Newest cross-entropy of the AIPs and that of the best constants, in nats, as the terminal shows them.
    pub(crate) aip_loss: Option<[f64; 2]>,
}

impl RunStatus {
    pub(crate) fn of(run: &RunRecord) -> RunStatus {
        let written = fs::metadata(run.dir.join(files::TIMING)).and_then(|timing| timing.modified()).ok();
        let idle = written.and_then(|then| SystemTime::now().duration_since(then).ok()).unwrap_or_default();
        of(run, Directory::is_locked(&run.dir), idle)
    }
}

/// `locked`: whether a process is writing the run. `idle`: time since the end of the last period was written.
fn of(run: &RunRecord, locked: bool, idle: Duration) -> RunStatus {
    let end = run.config.learning.end();
    let state = match (run.status(), locked) {
        (_, true) => State::Running,
        (Status::Finished, false) => State::Finished,
        (Status::Unfinished { .. } | Status::Empty, false) => State::Stopped,
    };
    let steps = run.trained_to().min(end);
    let steps_per_s = last_period(run);
    let since = if state == State::Running { idle.as_secs_f64() } else { 0.0 };
    let about_steps = steps_per_s.map_or(steps, |speed| steps + (speed * since) as u64).min(end);
    let left = steps_per_s.filter(|_| state == State::Running);
    let left = left.map(|speed| Duration::from_secs_f64((end - about_steps) as f64 / speed));
    let agents = run.scenario().id.agents;
    let agent_steps_per_s = steps_per_s.map(|speed| speed * agents as f64).filter(|_| agents > 0);
    RunStatus { state, steps, about_steps, end, agent_steps_per_s, left, aip_loss: aip_loss(run) }
}

/// Returns the loss on new episodes, or on held-out ones if the AIPs have been trained since.
fn aip_loss(run: &RunRecord) -> Option<[f64; 2]> {
    let (trained, fresh) = (run.aip_trainings.last(), run.fresh_losses.last());
    match fresh.filter(|fresh| trained.is_none_or(|trained| fresh.steps >= trained.steps)) {
        Some(fresh) => Some([fresh.loss, fresh.marginals]),
        None => trained.map(|trained| [trained.after, trained.marginals]),
    }
}

/// Returns the timesteps per agent and second of the last period that trained.
fn last_period(run: &RunRecord) -> Option<f64> {
    let mut ends = run.periods.iter().rev().map(|period| (period.steps, period.elapsed_s));
    let (steps, elapsed_s) = ends.next()?;
    // A resumed run counts its seconds from its beginning, as all its periods do.
    let (before, from_s) = ends.find(|(before, _)| *before < steps).unwrap_or((0, 0.0));
    let speed = (steps - before) as f64 / (elapsed_s - from_s);
    (speed.is_finite() && speed > 0.0).then_some(speed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;
    use dials_session::records::run_record::{AipTrainingRecord, FreshLossRecord, PeriodTime};

    /// A run of 1000 timesteps, so of 8 updates after 128 timesteps each: it ends at 1024. It was evaluated at these steps, at these seconds.
    fn run(ends: &[(u64, f64)]) -> RunRecord {
        let period = |&(steps, elapsed_s): &(u64, f64)| PeriodTime { steps, elapsed_s, ..PeriodTime::default() };
        RunRecord {
            evaluations: ends.iter().map(|(steps, _)| fixtures::evaluation(*steps, 1.0)).collect(),
            periods: ends.iter().map(period).collect(),
            ..fixtures::run("total_steps = 1000")
        }
    }

    #[test]
    fn a_run_that_is_written_goes_on_at_the_speed_of_its_last_period_and_others_stand_still() {
        let seconds = |seconds: f64| Some(Duration::from_secs_f64(seconds));
        // It was evaluated at its beginning only, and has trained since.
        let mut between = run(&[(0, 1.0), (300, 30.0)]);
        between.evaluations.pop();
        for (run, locked, idle_s, expected) in [
            (run(&[(100, 10.0), (300, 30.0)]), true, 20, (State::Running, 300, 500, seconds(52.4))),
            // It cannot have passed its last step.
            (run(&[(100, 10.0), (900, 90.0)]), true, 600, (State::Running, 900, 1024, seconds(0.0))),
            (run(&[(100, 10.0), (300, 30.0)]), false, 20, (State::Stopped, 300, 300, None)),
            (between, false, 20, (State::Stopped, 300, 300, None)),
            (run(&[]), true, 20, (State::Running, 0, 0, None)),
        ] {
            let status = of(&run, locked, Duration::from_secs(idle_s));
            assert_eq!((status.state, status.steps, status.about_steps, status.left), expected);
        }
    }

    #[test]
    fn the_newest_aip_loss_is_of_new_episodes_unless_the_aips_were_trained_after_them() {
        let trained = |steps| AipTrainingRecord { steps, before: 0.9, after: 0.2, marginals: 0.3 };
        let fresh = |steps| FreshLossRecord { steps, after_training: false, loss: 0.4, marginals: 0.5 };
        let newest = |trainings: &[u64], measured: &[u64]| {
            let aip_trainings = trainings.iter().copied().map(trained).collect();
            let fresh_losses = measured.iter().copied().map(fresh).collect();
            of(&RunRecord { aip_trainings, fresh_losses, ..run(&[]) }, false, Duration::ZERO).aip_loss
        };
        assert_eq!(newest(&[], &[]), None);
        assert_eq!(newest(&[], &[100]), Some([0.4, 0.5]));
        assert_eq!(newest(&[100], &[]), Some([0.2, 0.3]));
        assert_eq!(newest(&[100, 200], &[100]), Some([0.2, 0.3]));
        // A measurement at the step of a training follows it.
        assert_eq!(newest(&[100, 200], &[100, 200]), Some([0.4, 0.5]));
        assert_eq!(newest(&[100], &[200]), Some([0.4, 0.5]));
    }
}
