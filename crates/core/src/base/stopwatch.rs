//! Where the time goes: the activities of workers between two exchanges, and their phases.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

named! {
    /// Activity of a worker between two exchanges (the lines of Algorithm 1). Its name is in the columns of `timing.csv`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub enum Activity {
        Training = "training",
        /// Algorithm 2: datasets from the GS.
        Collection = "collection",
        AipTraining = "aip_training",
        /// Evaluation episodes on the GS.
        Evaluation = "evaluation",
    }
}

named! {
    /// Phase of an activity. No activity has all of them. Its name is in the columns of `timing.csv`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub enum Phase {
        /// Making simulators (traffic: networks are written and read).
        Loading = "loading",
        /// Bringing simulators back to their state at the end of the last period.
        Retracing = "retracing",
        /// Beginning episodes (traffic: cars are removed, lights set; on the GS the network is read again).
        Reset = "reset",
        /// Setting the simulator's inputs (traffic: lights and cars).
        Insertion = "insertion",
        /// The simulator's own step (traffic: inside SUMO).
        SimulatorStep = "simulator_step",
        /// Reading the results and turning them into observations and rewards.
        Reading = "reading",
        /// Forward passes of the policies for decisions and advantages, and drawing actions.
        Acting = "acting",
        AipSampling = "aip_sampling",
        /// Writing samples to memory and arranging them for the networks: advantages, minibatches.
        Bookkeeping = "bookkeeping",
        /// Forward passes of a training, with the loss.
        Forward = "forward",
        Backward = "backward",
        Adam = "adam",
    }
}

/// Where a long computation reports its times and its progress.
pub struct Work<'a, Progress> {
    /// Collects the time of each phase.
    pub watch: &'a mut Stopwatch,
    /// Is called from time to time with how far the computation is.
    pub progress: &'a mut dyn FnMut(Progress),
}

/// A sum of wall time per phase. A reading costs tens of nanoseconds, so time the work of many rows at once, not of
/// one.
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

    /// Adds time that was measured elsewhere.
    pub fn note(&mut self, phase: Phase, time: Duration) {
        self.spent[phase as usize] += time;
    }

    pub fn add(&mut self, other: &Stopwatch) {
        for (mine, theirs) in self.spent.iter_mut().zip(other.spent) {
            *mine += theirs;
        }
    }

    /// Scales all phases to another total: turns phases that threads measured side by side into wall time.
    pub fn scaled_to(&self, total: Duration) -> Stopwatch {
        if self.total().is_zero() {
            return self.clone();
        }
        let factor = total.as_secs_f64() / self.total().as_secs_f64();
        Stopwatch { spent: self.spent.map(|spent| spent.mul_f64(factor)) }
    }

    pub fn spent(&self, phase: Phase) -> Duration {
        self.spent[phase as usize]
    }

    pub fn total(&self) -> Duration {
        self.spent.iter().sum()
    }

    pub fn take(&mut self) -> Stopwatch {
        std::mem::take(self)
    }
}

/// Wall time of every activity and its phases, and CPU time of the process.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Timesheet {
    activities: [(Duration, Stopwatch); Activity::ALL.len()],
    /// CPU time of the whole process, all threads.
    cpu: Duration,
    cpu_of: [Duration; Activity::ALL.len()],
}

impl Timesheet {
    /// Adds an activity that took the time `whole`; `phases` of it are known.
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

    /// Makes a timesheet of CPU time that belongs to no activity.
    pub fn of_cpu(cpu: Duration) -> Timesheet {
        Timesheet { cpu, ..Timesheet::default() }
    }

    /// Adds the CPU time of all the activities noted here. It is shared among them by wall time, so a single activity
    /// gets all of it.
    pub fn note_cpu(&mut self, cpu: Duration) {
        self.cpu += cpu;
        let total = self.total().as_secs_f64();
        for ((whole, _), of_activity) in self.activities.iter().zip(&mut self.cpu_of) {
            if *whole > Duration::ZERO {
                *of_activity += cpu.mul_f64(whole.as_secs_f64() / total);
            }
        }
    }

    /// Returns the CPU time of the process, all threads. A part of it may belong to no activity.
    pub fn cpu(&self) -> Duration {
        self.cpu
    }

    pub fn cpu_of(&self, activity: Activity) -> Duration {
        self.cpu_of[activity as usize]
    }

    /// Returns the wall time of an activity, including time in none of its phases.
    pub fn whole(&self, activity: Activity) -> Duration {
        self.activities[activity as usize].0
    }

    pub fn phases(&self, activity: Activity) -> &Stopwatch {
        &self.activities[activity as usize].1
    }

    pub(crate) fn total(&self) -> Duration {
        self.activities.iter().map(|(whole, _)| *whole).sum()
    }

    /// Returns the longest of its times. A sum of many times that are not absurdly long cannot overflow.
    pub fn longest(&self) -> Duration {
        let walls = self.activities.iter().flat_map(|(whole, phases)| phases.spent.iter().chain([whole]));
        walls.chain(&self.cpu_of).fold(self.cpu, |longest, &time| longest.max(time))
    }

    /// Returns everything and starts again from zero.
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
        assert_eq!(all.cpu(), seconds(24));
        let activities = [Activity::Training, Activity::Evaluation, Activity::Collection];
        assert_eq!(activities.map(|activity| all.cpu_of(activity)), [19, 4, 0].map(seconds));
    }
}
