//! Schedule of runs on the cores: in the order of the plan, each run starts as soon as enough cores are free.

/// Returns the number of cores for a run. Small runs take one core each and run side by side; large ones take all
/// cores. Training on the GS always takes one core: more would share only the updates.
pub fn width(agents: usize, on_the_gs: bool, all_cores_from_agents: usize, cores: usize) -> usize {
    if on_the_gs || agents < all_cores_from_agents { 1 } else { cores }
}

#[derive(Clone, Copy, Debug)]
pub struct Cores {
    pub(crate) free: usize,
    pub(crate) all: usize,
}

impl Cores {
    pub fn new(all: usize) -> Self {
        Cores { free: all, all }
    }

    /// Takes cores if enough are free, and returns whether it did. A run that wants more than there are takes all.
    pub fn take(&mut self, width: usize) -> bool {
        let width = width.min(self.all);
        let enough = width <= self.free;
        if enough {
            self.free -= width;
        }
        enough
    }

    pub fn give_back(&mut self, width: usize) {
        self.free += width.min(self.all);
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Job {
    pub width: usize,
    pub seconds: f64,
    pub memory_mb: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Total {
    pub seconds: f64,
    /// Largest memory at any time.
    pub memory_mb: f64,
}

/// Simulates a schedule and returns its duration and memory.
pub fn total(jobs: &[Job], cores: usize) -> Total {
    let mut cores = Cores::new(cores);
    let mut waiting = jobs.iter().peekable();
    // Running jobs, with their end times.
    let mut working: Vec<(f64, Job)> = Vec::new();
    let mut total = Total { seconds: 0.0, memory_mb: 0.0 };
    loop {
        while let Some(job) = waiting.next_if(|job| cores.take(job.width)) {
            working.push((total.seconds + job.seconds, *job));
        }
        total.memory_mb = total.memory_mb.max(working.iter().fold(0.0, |sum, (_, job)| sum + job.memory_mb));
        let Some(next) = (0..working.len()).min_by(|&a, &b| working[a].0.total_cmp(&working[b].0)) else {
            return total;
        };
        let (end, job) = working.swap_remove(next);
        total.seconds = end;
        cores.give_back(job.width);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job(width: usize, seconds: f64) -> Job {
        Job { width, seconds, memory_mb: 100.0 * width as f64 }
    }

    #[test]
    fn small_runs_stand_beside_each_other_and_large_ones_alone() {
        // On two cores: 10 s and 30 s start at 0, the second 10 s at 10. The large run waits for 30 s, and ends at 37.
        let jobs = [job(1, 10.0), job(1, 30.0), job(1, 10.0), job(2, 7.0)];
        assert_eq!(total(&jobs, 2), Total { seconds: 37.0, memory_mb: 200.0 });
        assert_eq!(total(&jobs, 1).seconds, 57.0, "one after the other");
        assert_eq!(total(&[], 4).seconds, 0.0);
    }

    #[test]
    fn the_gs_has_one_core_and_a_large_scenario_all() {
        assert_eq!([width(4, false, 25, 8), width(25, false, 25, 8), width(25, true, 25, 8)], [1, 8, 1]);
    }
}
