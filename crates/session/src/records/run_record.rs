//! The contents of a run directory as numbers. `reader.rs` reads them.

use std::path::PathBuf;

use super::run_json::RunJson;
use crate::config::RunConfig;
use dials_core::domain::Scenario;

#[derive(Clone, Debug)]
pub struct RunRecord {
    pub dir: PathBuf,
    pub config: RunConfig,
    pub about: RunJson,
    /// Evaluations, in order of steps.
    pub evaluations: Vec<EvaluationRecord>,
    /// Trainings of the AIPs, in order of steps.
    pub aip_trainings: Vec<AipTrainingRecord>,
    /// Cross-entropies of the AIPs on new GS data, in order of steps; empty if the run did not measure them.
    pub fresh_losses: Vec<FreshLossRecord>,
    /// Local simulators beside the global one, in order of steps; empty if the domain does not compare them.
    pub likeness: Vec<LikenessRecord>,
    pub periods: Vec<PeriodTime>,
    pub memory: Option<MemoryRecord>,
    /// Number of worker processes, or 1 for a run without any.
    pub workers: usize,
}

#[derive(Clone, Debug)]
pub struct EvaluationRecord {
    /// Timesteps per agent.
    pub steps: u64,
    pub all: Returns,
    pub agents: Vec<Returns>,
    /// Mean returns of all agents, episode by episode.
    pub episode_returns: Vec<f64>,
}

/// Figures of an evaluation, of one agent or of all.
#[derive(Clone, Copy, Debug)]
pub struct Returns {
    pub mean: f64,
    /// Median. For all agents: over the agents' means.
    pub median: f64,
    /// Standard error of the mean over the episodes.
    pub std_error: f64,
    /// Number of stuck agents; 0 or 1 for one agent.
    pub stuck: usize,
}

/// Cross-entropy in nats on the held-out episodes of a dataset; the mean of all agents and sources.
#[derive(Clone, Copy, Debug)]
pub struct AipTrainingRecord {
    pub steps: u64,
    pub before: f64,
    pub after: f64,
    /// Cross-entropy of the best constant.
    pub marginals: f64,
}

/// Cross-entropy in nats on GS episodes that no AIP was trained on; the mean of all agents and sources.
#[derive(Clone, Copy, Debug)]
pub struct FreshLossRecord {
    pub steps: u64,
    /// Whether the AIPs have just been trained here.
    pub after_training: bool,
    pub loss: f64,
    /// Cross-entropy of the best constant.
    pub marginals: f64,
}

/// What the GS in an evaluation, and the local simulators before it, show of the same lights: pairs in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LikenessRecord {
    /// Steps of the evaluation.
    pub(crate) steps: u64,
    /// Mean number of cars on the approaches of a light.
    pub cars: [f64; 2],
    /// Mean speed of these cars in metres per second.
    pub speed_mps: [f64; 2],
}

/// Wall and CPU seconds since the run began, at the end of a period.
#[derive(Clone, Copy, Debug, Default)]
pub struct PeriodTime {
    pub steps: u64,
    pub elapsed_s: f64,
    /// Part of it for evaluations of policies and AIPs, which are not part of the training.
    pub evaluation_s: f64,
    /// Part of it for the collection of datasets and the training of the AIPs.
    pub influence_s: f64,
    /// Part of it for the gradient steps of PPO.
    pub update_s: f64,
    pub cpu: CpuTime,
}

impl PeriodTime {
    /// Returns the wall time without the evaluations, as the paper counts it.
    pub fn runtime_s(self) -> f64 {
        self.elapsed_s - self.evaluation_s
    }
}

/// CPU seconds of all processes, user and system.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CpuTime {
    pub total_s: f64,
    pub evaluation_s: f64,
}

impl CpuTime {
    pub fn runtime_s(self) -> f64 {
        self.total_s - self.evaluation_s
    }
}

/// Peak memory in MiB.
#[derive(Clone, Copy, Debug)]
pub struct MemoryRecord {
    /// Memory of the largest process, shared libraries counted in full.
    pub process_mb: f64,
    /// Memory of all processes, shared libraries counted in full in each.
    pub total_mb: f64,
    /// Memory of all processes, shared pages counted once.
    pub total_pss_mb: f64,
}

impl MemoryRecord {
    pub fn max(self, other: MemoryRecord) -> MemoryRecord {
        MemoryRecord {
            process_mb: self.process_mb.max(other.process_mb),
            total_mb: self.total_mb.max(other.total_mb),
            total_pss_mb: self.total_pss_mb.max(other.total_pss_mb),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    Finished,
    /// The run has evaluations up to this step.
    Unfinished {
        steps: u64,
    },
    /// The run has no evaluation yet, not even at its beginning.
    Empty,
}

impl RunRecord {
    /// Makes the record of a run that has written nothing yet, for tests.
    pub fn empty(config: RunConfig, scenario: Scenario) -> RunRecord {
        RunRecord {
            dir: PathBuf::new(),
            about: RunJson::new(scenario, Vec::new(), config.learning.seed),
            config,
            evaluations: Vec::new(),
            aip_trainings: Vec::new(),
            fresh_losses: Vec::new(),
            likeness: Vec::new(),
            periods: Vec::new(),
            memory: None,
            workers: 1,
        }
    }

    pub fn scenario(&self) -> &Scenario {
        &self.about.scenario
    }

    pub fn status(&self) -> Status {
        match self.evaluations.last() {
            None => Status::Empty,
            // Periods are whole updates of the policies, so the last one may end a little later than the config says.
            Some(last) if last.steps >= self.config.learning.last_step() => Status::Finished,
            Some(last) => Status::Unfinished { steps: last.steps },
        }
    }

    /// Returns whether all is there that a finished run writes after its last evaluation. If not, a resume writes it.
    pub fn is_whole(&self) -> bool {
        let Some(last) = self.evaluations.last() else { return false };
        // The last period is one block of times, the evaluation after it another one. That one is written last.
        let blocks = self.periods.iter().filter(|period| period.steps == last.steps).count();
        blocks >= 2
    }

    pub fn evaluation_at(&self, steps: u64) -> Option<&EvaluationRecord> {
        let place = self.evaluations.binary_search_by_key(&steps, |evaluation| evaluation.steps).ok()?;
        self.evaluations.get(place)
    }

    /// Returns the step to which the run has trained: the end of its last period, where it wrote its last checkpoint.
    pub fn trained_to(&self) -> u64 {
        let evaluated = self.evaluations.last().map_or(0, |last| last.steps);
        self.periods.last().map_or(0, |last| last.steps).max(evaluated)
    }

    /// Returns the mean return of all agents at a step, interpolated between two evaluations. Outside of them: `None`.
    pub fn return_at(&self, steps: u64) -> Option<f64> {
        interpolate(&self.evaluations, |evaluation| (evaluation.steps, evaluation.all.mean), steps)
    }

    /// Returns the median over agents in the same way.
    pub fn median_at(&self, steps: u64) -> Option<f64> {
        interpolate(&self.evaluations, |evaluation| (evaluation.steps, evaluation.all.median), steps)
    }

    /// Returns the wall time without evaluations until a step, in seconds. If the run has not come so far: `None`.
    pub fn runtime_at(&self, steps: u64) -> Option<f64> {
        Some(self.time_at(steps)?.runtime_s())
    }

    /// Returns the CPU time until a step in seconds, of all processes, without evaluations.
    pub fn cpu_at(&self, steps: u64) -> Option<f64> {
        Some(self.time_at(steps)?.cpu.runtime_s())
    }

    /// Returns the time until a step: at the end of the last period that ends there, or interpolated between the ends
    /// of two periods. `None` if the run has not come so far, and in the first period of a run that imitates: the time of
    /// the imitation is known only with that period's.
    pub fn time_at(&self, steps: u64) -> Option<PeriodTime> {
        // Periods are in order of steps.
        let (until, next) = self.periods.split_at(self.periods.partition_point(|period| period.steps <= steps));
        if until.is_empty() && self.config.learning.policy.imitate.is_some() {
            return None;
        }
        let until = until.last().copied().unwrap_or_default();
        if until.steps == steps {
            return Some(until);
        }
        let next = next.first()?;
        let share = (steps - until.steps) as f64 / (next.steps - until.steps) as f64;
        let part = |figure: fn(&PeriodTime) -> f64| figure(&until) + share * (figure(next) - figure(&until));
        let total_s = part(|time| time.cpu.total_s);
        Some(PeriodTime {
            steps,
            elapsed_s: part(|time| time.elapsed_s),
            evaluation_s: part(|time| time.evaluation_s),
            influence_s: part(|time| time.influence_s),
            update_s: part(|time| time.update_s),
            cpu: CpuTime { total_s, evaluation_s: part(|time| time.cpu.evaluation_s) },
        })
    }

    pub fn total_time(&self) -> Option<PeriodTime> {
        self.periods.last().copied()
    }
}

/// Interpolates linearly between the points left and right of `at`. Outside of them: `None`. If two points have the
/// same place, the first counts. `items` are in order of the places of their points.
fn interpolate<T>(items: &[T], point: impl Fn(&T) -> (u64, f64), at: u64) -> Option<f64> {
    let (before, here) = items.split_at(items.partition_point(|item| point(item).0 < at));
    let (place, value) = point(here.first()?);
    if place == at {
        return Some(value);
    }
    let (left, left_value) = point(before.last()?);
    let share = (at - left) as f64 / (place - left) as f64;
    Some(left_value + share * (value - left_value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_evaluations_a_curve_is_a_straight_line_and_beyond_them_there_is_none() {
        let at = |steps| interpolate(&[(100, 10.0), (300, 20.0), (300, 90.0)], |&point| point, steps);
        // A quarter of the way from 100 to 300 the value is 10 + 10 / 4.
        assert_eq!((at(100), at(150), at(300)), (Some(10.0), Some(12.5), Some(20.0)));
        assert_eq!((at(99), at(301)), (None, None));
    }

    #[test]
    fn the_time_of_an_imitation_is_known_only_at_the_end_of_the_first_period() {
        let runtimes = |keys: &str| {
            let config = toml::from_str(&format!("{keys}\n[warehouse]\nagents_per_side = 2")).unwrap();
            let period = |(steps, elapsed_s)| PeriodTime { steps, elapsed_s, ..PeriodTime::default() };
            let periods = [(100, 10.0), (200, 30.0)].map(period).to_vec();
            let run = RunRecord { periods, ..RunRecord::empty(config, Scenario::new("ants", 3, 5)) };
            [0, 50, 100, 150].map(|steps| run.runtime_at(steps))
        };
        assert_eq!(runtimes(""), [Some(0.0), Some(5.0), Some(10.0), Some(20.0)]);
        assert_eq!(runtimes("policy.imitate = 'oldest-item'"), [None, None, Some(10.0), Some(20.0)]);
    }
}
