//! Where the time goes: what workers do between two exchanges, and which phases it is made of.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

/// What a worker is asked to do between two exchanges (the lines of Algorithm 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Activity {
    /// Training of the policies.
    Training,
    /// Algorithm 2: datasets from the GS.
    Collection,
    /// Training of the AIPs.
    AipTraining,
    /// Evaluation episodes on the GS.
    Evaluation,
}

impl Activity {
    pub const ALL: [Activity; 4] =
        [Activity::Training, Activity::Collection, Activity::AipTraining, Activity::Evaluation];

    /// As in the columns of `timing.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Activity::Training => "training",
            Activity::Collection => "collection",
            Activity::AipTraining => "aip_training",
            Activity::Evaluation => "evaluation",
        }
    }
}

/// What the time of an activity goes into. No activity has all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// Simulators are made (traffic: networks written and read).
    Loading,
    /// Simulators are brought back to where the last period left them.
    Retracing,
    /// Episodes begin (traffic: cars taken off, lights set; on the GS the network read again).
    Reset,
    /// The simulator is told what shall happen (traffic: lights and cars).
    Insertion,
    /// The simulator's own step (traffic: inside SUMO).
    SimulatorStep,
    /// What happened is read and turned into observations and rewards.
    Reading,
    /// Forward passes of the policies for decisions and advantages, and the draw of actions.
    Acting,
    /// Sampling of influence sources from the AIPs.
    AipSampling,
    /// What is remembered is written down and laid out for the networks: advantages, minibatches.
    Bookkeeping,
    /// Forward passes of a training, with the loss.
    Forward,
    /// Gradients of a training.
    Backward,
    /// Steps of the optimiser.
    Adam,
}

impl Phase {
    pub const ALL: [Phase; 12] = [
        Phase::Loading,
        Phase::Retracing,
        Phase::Reset,
        Phase::Insertion,
        Phase::SimulatorStep,
        Phase::Reading,
        Phase::Acting,
        Phase::AipSampling,
        Phase::Bookkeeping,
        Phase::Forward,
        Phase::Backward,
        Phase::Adam,
    ];

    /// As in the columns of `timing.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Loading => "loading",
            Phase::Retracing => "retracing",
            Phase::Reset => "reset",
            Phase::Insertion => "insertion",
            Phase::SimulatorStep => "simulator_step",
            Phase::Reading => "reading",
            Phase::Acting => "acting",
            Phase::AipSampling => "aip_sampling",
            Phase::Bookkeeping => "bookkeeping",
            Phase::Forward => "forward",
            Phase::Backward => "backward",
            Phase::Adam => "adam",
        }
    }
}

/// Adds up wall time per phase. A reading costs tens of nanoseconds: it belongs around the work of many rows, not of one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Stopwatch {
    spent: [Duration; Phase::ALL.len()],
}

impl Stopwatch {
    pub fn time<T>(&mut self, phase: Phase, work: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let result = work();
        self.note(phase, begun.elapsed());
        result
    }

    /// Time that somebody else measured.
    pub fn note(&mut self, phase: Phase, time: Duration) {
        self.spent[phase as usize] += time;
    }

    pub fn add(&mut self, other: &Stopwatch) {
        for (mine, theirs) in self.spent.iter_mut().zip(other.spent) {
            *mine += theirs;
        }
    }

    /// The same shares of another total: of phases that threads measured side by side, in wall time.
    pub fn scaled_to(&self, total: Duration) -> Stopwatch {
        let factor = total.as_secs_f64() / self.total().as_secs_f64().max(f64::MIN_POSITIVE);
        Stopwatch { spent: self.spent.map(|spent| spent.mul_f64(factor)) }
    }

    pub fn spent(&self, phase: Phase) -> Duration {
        self.spent[phase as usize]
    }

    /// All phases together.
    pub fn total(&self) -> Duration {
        self.spent.iter().sum()
    }

    /// Reads all phases and starts again from zero.
    pub fn take(&mut self) -> Stopwatch {
        std::mem::take(self)
    }
}

/// The wall time of every activity and its phases, and the CPU time of the process.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Timesheet {
    activities: [(Duration, Stopwatch); Activity::ALL.len()],
    /// CPU time of the whole process, all threads.
    cpu: Duration,
    /// CPU time of each activity.
    cpu_of: [Duration; Activity::ALL.len()],
}

impl Timesheet {
    /// An activity took the time `whole`; `phases` of it are known.
    pub fn note(&mut self, activity: Activity, whole: Duration, phases: &Stopwatch) {
        let (time, watch) = &mut self.activities[activity as usize];
        *time += whole;
        watch.add(phases);
    }

    pub fn add(&mut self, other: &Timesheet) {
        for (activity, (whole, phases)) in Activity::ALL.into_iter().zip(&other.activities) {
            self.note(activity, *whole, phases);
        }
        self.cpu += other.cpu;
        for (mine, theirs) in self.cpu_of.iter_mut().zip(other.cpu_of) {
            *mine += theirs;
        }
    }

    /// CPU time that belongs to no activity.
    pub fn of_cpu(cpu: Duration) -> Timesheet {
        Timesheet { cpu, ..Timesheet::default() }
    }

    /// Adds the CPU time in which all that is noted here was done: shared by wall time, so all of it goes to an activity that
    /// stands here alone.
    pub fn note_cpu(&mut self, cpu: Duration) {
        self.cpu += cpu;
        let total = self.total().as_secs_f64();
        for ((whole, _), of_activity) in self.activities.iter().zip(&mut self.cpu_of) {
            if *whole > Duration::ZERO {
                *of_activity += cpu.mul_f64(whole.as_secs_f64() / total);
            }
        }
    }

    /// CPU time of the process, all threads; a part of it may belong to no activity.
    pub fn cpu(&self) -> Duration {
        self.cpu
    }

    /// CPU time of an activity.
    pub fn cpu_of(&self, activity: Activity) -> Duration {
        self.cpu_of[activity as usize]
    }

    /// With what is in none of its phases.
    pub fn whole(&self, activity: Activity) -> Duration {
        self.activities[activity as usize].0
    }

    pub fn phases(&self, activity: Activity) -> &Stopwatch {
        &self.activities[activity as usize].1
    }

    /// All activities together.
    pub fn total(&self) -> Duration {
        self.activities.iter().map(|(whole, _)| *whole).sum()
    }

    /// Reads everything and starts again from zero.
    pub fn take(&mut self) -> Timesheet {
        std::mem::take(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cpu_time_goes_to_the_activity_that_was_noted_with_it() {
        let seconds = Duration::from_secs;
        let order = |activity, wall, cpu| {
            let mut timesheet = Timesheet::default();
            timesheet.note(activity, seconds(wall), &Stopwatch::default());
            timesheet.note_cpu(seconds(cpu));
            timesheet
        };
        let mut all = order(Activity::Training, 10, 19);
        all.add(&order(Activity::Evaluation, 5, 4));
        // Preparing an order is no activity.
        all.add(&Timesheet::of_cpu(seconds(1)));
        let of = |activity| all.cpu_of(activity);
        assert_eq!(
            (all.cpu(), of(Activity::Training), of(Activity::Evaluation)),
            (seconds(24), seconds(19), seconds(4))
        );
        assert_eq!(of(Activity::Collection), Duration::ZERO);
    }
}
