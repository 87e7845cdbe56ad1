//! Final results of a group: return, agents, runtime and memory.

use super::group::{Comparison, Group};
use dials_core::base::statistics::difference::{BySeed, Episodes, Played, common_episodes};
use dials_core::base::statistics::{Spread, mean, median};
use dials_session::records::run_record::{
    CpuTime, EvaluationRecord, MemoryRecord, PeriodTime, Returns, RunRecord, Status,
};

pub(crate) struct Final {
    /// Timesteps per agent at which the returns were measured.
    pub(crate) steps: u64,
    /// Whether the runs that count are finished. [`Group::finals`] says which ones count.
    pub(crate) finished: bool,
    pub(crate) returns: Spread,
    pub(crate) runs: BySeed,
    pub(crate) median_run: f64,
    /// Return of the median agent of a run, mean over seeds.
    pub(crate) median_agent: f64,
    pub(crate) worst_agent: AgentAt,
    pub(crate) stuck: Vec<AgentAt>,
    pub(crate) agents: usize,
    pub(crate) agent_means: Vec<f64>,
    pub(crate) agents_of_runs: Vec<(u64, Vec<Returns>)>,
}

fn finished(runs: &[&RunRecord]) -> bool {
    runs.iter().all(|run| run.status() == Status::Finished)
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AgentAt {
    pub(crate) seed: u64,
    pub(crate) agent: usize,
    pub(crate) mean_return: f64,
}

impl Final {
    /// Collects the final returns of a group; `None` if no run of it was evaluated.
    pub(crate) fn of(group: &Group) -> Option<Final> {
        let (steps, runs) = group.finals()?;
        let agents_of_runs: Vec<(u64, Vec<Returns>)> =
            runs.iter().map(|run| (run.config.learning.seed, agents_at(run, steps).to_vec())).collect();
        let everyone = || {
            agents_of_runs.iter().flat_map(|(seed, agents)| {
                let at = |(agent, returns): (usize, &Returns)| {
                    (AgentAt { seed: *seed, agent, mean_return: returns.mean }, returns.stuck > 0)
                };
                agents.iter().enumerate().map(at)
            })
        };
        let worst_agent = everyone().map(|(agent, _)| agent).min_by(|a, b| a.mean_return.total_cmp(&b.mean_return))?;
        let of_runs = played(&runs, steps);
        let means: Vec<f64> = of_runs.iter().map(|(_, played)| played.mean).collect();
        let medians: Vec<f64> = runs.iter().filter_map(|run| Some(run.evaluation_at(steps)?.all.median)).collect();
        let count = agents_of_runs.first().map_or(0, |(_, agents)| agents.len());
        let agent_means = (0..count)
            .map(|agent| mean(&agents_of_runs.iter().map(|(_, agents)| agents[agent].mean).collect::<Vec<_>>()));
        Some(Final {
            steps,
            finished: finished(&runs),
            returns: Spread::of(&means)?,
            median_run: median(&means),
            median_agent: mean(&medians),
            worst_agent,
            stuck: everyone().filter(|(_, stuck)| *stuck).map(|(agent, _)| agent).collect(),
            agents: everyone().count(),
            agent_means: agent_means.collect(),
            runs: of_runs,
            agents_of_runs,
        })
    }

    /// Returns the episodes that all runs played; `None` if they differ.
    pub(crate) fn episodes(&self) -> Option<Episodes> {
        common_episodes(self.runs.iter().map(|(_, played)| played))
    }
}

impl Comparison {
    pub(crate) fn ends(&self) -> Vec<(&Group, Final)> {
        self.groups.iter().filter_map(|group| Some((group, Final::of(group)?))).collect()
    }

    /// Returns the words for the time of [`Comparison::ends`]: the end, or the last evaluation so far.
    pub(crate) fn when(&self) -> &'static str {
        if self.ends().iter().all(|(_, end)| end.finished) { "at the end" } else { "at the last evaluation so far" }
    }
}

pub(crate) fn played(runs: &[&RunRecord], steps: u64) -> BySeed {
    let played = runs.iter().filter_map(|run| {
        let EvaluationRecord { all, episode_returns, .. } = run.evaluation_at(steps)?;
        let played = Played::new(all.mean, run.config.learning.evaluation.seed, episode_returns.clone());
        Some((run.config.learning.seed, played))
    });
    played.collect()
}

pub(crate) fn agents_at(run: &RunRecord, steps: u64) -> &[Returns] {
    run.evaluation_at(steps).map_or(&[], |evaluation| &evaluation.agents)
}

/// Wall and CPU time in seconds, means over the runs of a group.
pub(crate) struct Runtime {
    /// Timesteps per agent.
    pub(crate) steps: u64,
    pub(crate) finished: bool,
    pub(crate) agents_training_s: f64,
    /// Time to collect datasets and train the AIPs.
    pub(crate) influence_s: f64,
    /// Sum of the two over seeds: wall time without evaluations.
    pub(crate) total: Spread,
    pub(crate) wall_s: f64,
    pub(crate) cpu: CpuTime,
    pub(crate) workers: usize,
}

impl Runtime {
    /// Averages over the runs that count for the final return, up to the step of that return; `None` if there is none.
    pub(crate) fn of(group: &Group) -> Option<Runtime> {
        let (steps, runs) = group.finals()?;
        let times: Vec<PeriodTime> = runs.iter().filter_map(|run| run.time_at(steps)).collect();
        let mean_of = |part: &dyn Fn(&PeriodTime) -> f64| mean(&times.iter().map(part).collect::<Vec<_>>());
        let total = Spread::of(&times.iter().map(|time| time.runtime_s()).collect::<Vec<_>>())?;
        let influence_s = mean_of(&|time| time.influence_s);
        Some(Runtime {
            steps,
            finished: finished(&runs),
            agents_training_s: total.mean - influence_s,
            influence_s,
            total,
            wall_s: mean_of(&|time| time.elapsed_s),
            cpu: mean_cpu(&times),
            workers: runs.iter().map(|run| run.workers).max().unwrap_or(1),
        })
    }
}

pub(crate) fn mean_cpu(times: &[PeriodTime]) -> CpuTime {
    let mean_of = |part: fn(&CpuTime) -> f64| mean(&times.iter().map(|time| part(&time.cpu)).collect::<Vec<_>>());
    CpuTime { total_s: mean_of(|cpu| cpu.total_s), evaluation_s: mean_of(|cpu| cpu.evaluation_s) }
}

pub(crate) fn peak_memory(group: &Group) -> Option<MemoryRecord> {
    group.runs.iter().filter_map(|run| run.memory).reduce(MemoryRecord::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;

    #[test]
    fn the_runtime_of_unfinished_runs_is_until_the_step_that_all_have_reached() {
        // 1 s per 1000 steps: a fifth for evaluations and a tenth for the AIPs. A period has 4000 steps.
        let time = |period: u64| PeriodTime {
            steps: period * 4000,
            elapsed_s: 4.0 * period as f64,
            evaluation_s: 0.8 * period as f64,
            influence_s: 0.4 * period as f64,
            update_s: 0.2 * period as f64,
            cpu: CpuTime { total_s: 8.0 * period as f64, evaluation_s: 1.6 * period as f64 },
        };
        let run = |periods: u64| RunRecord {
            evaluations: (1..=periods).map(|period| fixtures::evaluation(period * 4000 - 2000, 1.0)).collect(),
            periods: (1..=periods).map(time).collect(),
            ..fixtures::run("total_steps = 100000")
        };
        let time = Runtime::of(&fixtures::group(vec![run(2), run(20)])).unwrap();
        // Both runs until 6000: 6 s, minus 1.2 s of evaluations. 0.6 s are for the AIPs.
        assert_eq!((time.steps, time.finished, time.wall_s), (6000, false, 6.0));
        // Two threads work all the time.
        for (found, expected) in [
            (time.total.mean, 4.8),
            (time.influence_s, 0.6),
            (time.agents_training_s, 4.2),
            (time.cpu.total_s, 12.0),
            (time.cpu.runtime_s(), 9.6),
        ] {
            assert!((found - expected).abs() < 1e-9, "{found} is not {expected}");
        }
    }
}
