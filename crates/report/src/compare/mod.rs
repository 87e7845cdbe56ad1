//! A comparison of two groups of runs: final return, runtime, and the steps and time to reach a return.
//!
//! Returns are compared at the last step at which all runs of both groups were evaluated.
//! [`dials_core::base::statistics::difference`] takes the difference: by episode and by seed if both are the same. If one side
//! played more of the same episodes, both are compared on those of the other.
//!
//! - `steps`: the step at which each side is compared. `rules`: whether returns can be compared at all.
//! - `text`, `as_json`: the result for people and for programs.

mod as_json;
mod rules;
pub(super) mod steps;
mod text;

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};

use self::steps::{are_alike, both_in_words, compared_at};
use super::finals::{agents_at, mean_cpu};
use super::group::{Group, Sorted, evaluated_together, sort};
use super::played;
use super::words::{no_run, warnings};
use dials_core::base::statistics::difference::{BySeed, Difference, between, on_shared, shared_episodes};
use dials_core::base::statistics::{ENOUGH_SEEDS, Spread, mean, median};
use dials_core::domain::ScenarioId;
use dials_core::outside::Printable;
use dials_session::records::find::{LeftOut, find};
use dials_session::records::method::differing;
use dials_session::records::run_record::{CpuTime, PeriodTime, RunRecord, Status};

/// How far the default return to reach is below the lower final return, as a share of its size.
const BELOW: f64 = 0.05;

/// One side of a comparison: runs of one method.
pub struct ComparedSide {
    /// Its name on the command line.
    pub(crate) name: String,
    pub(crate) scenario: ScenarioId,
    /// Title of the scenario.
    title: String,
    pub(crate) group: Group,
    left_out: Vec<LeftOut>,
}

impl ComparedSide {
    /// Reads the runs under these folders. Their configs may differ in the seed only.
    pub fn open(name: &str, folders: &[PathBuf]) -> Result<ComparedSide> {
        let found = find(folders)?;
        let missing = found.missing.clone();
        let Sorted { mut comparisons, left_out } = sort(found)?;
        let labels: Vec<String> = comparisons
            .iter()
            .flat_map(|comparison| {
                comparison.groups.iter().map(|group| format!("{}: {}", comparison.title, group.label()))
            })
            .collect();
        ensure!(
            labels.len() < 2,
            "{name}: holds runs of {} methods, but a side must have only one: {}",
            labels.len(),
            labels.join("; ")
        );
        let reasons = warnings(&comparisons, &missing, &left_out);
        let evaluated = comparisons.pop().filter(|found| found.groups.iter().any(|group| group.finals().is_some()));
        let comparison = evaluated.with_context(|| no_run(name, &reasons))?;
        let group = comparison.groups.into_iter().next().expect("the one that was counted");
        Ok(ComparedSide {
            name: name.to_owned(),
            scenario: comparison.scenario,
            title: comparison.title,
            group,
            left_out,
        })
    }
}

/// Steps and time that a side needed to reach a return.
pub(crate) struct Reached {
    /// Seed, timesteps and seconds of each run that reached it.
    pub(crate) runs: Vec<(u64, u64, Option<f64>)>,
    /// Number of all runs.
    pub(crate) of: usize,
}

impl Reached {
    /// Finds the first evaluation of each run with at least this mean return.
    fn of(runs: &[&RunRecord], target: f64) -> Reached {
        let first = |run: &&RunRecord| {
            let steps = run.evaluations.iter().find(|evaluation| evaluation.all.mean >= target)?.steps;
            Some((run.config.learning.seed, steps, run.runtime_at(steps)))
        };
        Reached { runs: runs.iter().filter_map(first).collect(), of: runs.len() }
    }

    /// Median timesteps of the runs that reached it.
    pub(crate) fn steps(&self) -> Option<f64> {
        let steps: Vec<f64> = self.runs.iter().map(|(_, steps, _)| *steps as f64).collect();
        (!steps.is_empty()).then(|| median(&steps))
    }

    /// Median seconds of the runs that reached it.
    pub(crate) fn seconds(&self) -> Option<f64> {
        let seconds: Vec<f64> = self.runs.iter().filter_map(|(_, _, seconds)| *seconds).collect();
        (!seconds.is_empty()).then(|| median(&seconds))
    }
}

/// The result of comparing `b` with `a`.
pub struct Verdict {
    /// Timesteps per agent at which the returns of each side were measured.
    pub(crate) steps: [u64; 2],
    pub(crate) returns: [Spread; 2],
    /// The runs that are compared, by seed, on the episodes that all of them played.
    pub(crate) runs: [BySeed; 2],
    /// Return of the median agent of a run, mean over seeds.
    pub(crate) median_agents: [f64; 2],
    /// Number of stuck agents and of all agents, over all runs.
    pub(crate) stuck: [(usize, usize); 2],
    pub(crate) difference: Difference,
    /// Mean wall seconds up to these timesteps, without evaluations.
    pub(crate) runtimes: [Option<f64>; 2],
    /// Mean CPU seconds up to these timesteps.
    pub(crate) cpu: [Option<CpuTime>; 2],
    /// Return to reach.
    pub(crate) target: f64,
    pub(crate) reached: [Reached; 2],
    /// Keys of the configs that differ, with both values. `None`: this side does not use the key.
    pub(crate) differing: Vec<(String, [Option<String>; 2])>,
    pub(crate) warnings: Vec<String>,
}

/// Compares two sides. `target`: the return to reach; by default the lower final return minus 5 % of its size.
pub fn compare(a: &ComparedSide, b: &ComparedSide, target: Option<f64>) -> Result<Verdict> {
    let mut warnings: Vec<String> = rules::check(a, b)?.into_iter().collect();
    let sides = [a, b];
    let [(end_a, runs_a), (end_b, runs_b)] = sides.map(|side| side.group.finals().expect("a side was evaluated"));
    let (ends, runs) = ([end_a, end_b], [runs_a, runs_b]);
    let evaluated = runs.each_ref().map(|runs| evaluated_together(runs));
    let steps = compared_at(&evaluated[0], &evaluated[1]).expect("a side was evaluated");
    let both = [0, 1].map(|side| (&runs[side], steps[side]));
    let played = both.map(|(runs, steps)| {
        let played = runs.iter().filter_map(|run| Some((run.config.learning.seed, played::of_run(run, steps)?)));
        played.collect::<BySeed>()
    });
    let shared = shared_episodes(played.iter().flatten().map(|(_, played)| played));
    if let Some(shared) = shared
        && played.iter().flatten().any(|(_, played)| played.episodes != shared)
    {
        warnings.push(format!(
            "not all runs were evaluated on the same number of episodes: mean returns are of the first {}, which all of \
             them have; the lines about agents are of all episodes",
            shared.count
        ));
    }
    let played = played.map(|side| on_shared(&side, shared));
    let returns = played.each_ref().map(|side| side.iter().map(|(_, played)| played.mean).collect::<Vec<f64>>());
    let found = between(&played[0], &played[1]);
    let median_agents = both.map(|(runs, steps)| {
        let medians = runs.iter().filter_map(|run| Some(run.evaluation_at(steps)?.all.median));
        mean(&medians.collect::<Vec<f64>>())
    });
    let stuck = both.map(|(runs, steps)| {
        let agents = runs.iter().flat_map(|run| agents_at(run, steps));
        agents.fold((0, 0), |(stuck, all), agent| (stuck + agent.stuck, all + 1))
    });
    let means = returns.each_ref().map(|returns| mean(returns));
    let lower = means[0].min(means[1]);
    let target = target.unwrap_or(lower - BELOW * lower.abs());
    let runtimes = both.map(|(runs, steps)| {
        let times: Vec<f64> = runs.iter().filter_map(|run| run.runtime_at(steps)).collect();
        (times.len() == runs.len()).then(|| mean(&times))
    });
    let cpu = both.map(|(runs, steps)| {
        let times: Option<Vec<PeriodTime>> = runs.iter().map(|run| run.time_at(steps)).collect();
        times.map(|times| mean_cpu(&times))
    });
    for (side, runs) in sides.iter().zip(&runs) {
        warnings.extend(side.left_out.iter().map(LeftOut::to_string));
        let unused = side.group.runs.iter().filter(|run| !runs.iter().any(|used| used.dir == run.dir));
        warnings.extend(unused.map(|run| {
            format!("{}: left out, because it has fewer steps than the others", Printable(run.dir.display()))
        }));
        if runs.iter().any(|run| run.status() != Status::Finished) {
            warnings.push(format!("{}: not finished", side.name));
        }
    }
    warnings.extend(of_steps(steps, ends));
    let workers = runs.each_ref().map(|runs| runs.iter().map(|run| run.workers).max().unwrap_or(1));
    if workers[0] != workers[1] {
        warnings
            .push(format!("A ran on {} workers and B on {}: their times are not comparable", workers[0], workers[1]));
    }
    if found.seeds.iter().any(|&seeds| seeds < ENOUGH_SEEDS) {
        let [a, b] = found.seeds;
        warnings.push(format!(
            "n = {a} in A and {b} in B: an interval needs {ENOUGH_SEEDS} seeds on each side; train more with --seed"
        ));
    }
    if !found.pairing.by_episode() {
        warnings.push(
            "A and B were not evaluated on the same episodes, so the difference is over seeds only and includes the \
             randomness of the traffic; `evaluate` with the same --seed plays the same episodes"
                .to_owned(),
        );
    }
    Ok(Verdict {
        steps,
        runs: played,
        cpu,
        median_agents,
        stuck,
        returns: returns.each_ref().map(|returns| Spread::of(returns).expect("a final return per run")),
        difference: found,
        runtimes,
        target,
        reached: runs.each_ref().map(|runs| Reached::of(runs, target)),
        differing: differing(&a.group.method.keys, &b.group.method.keys),
        warnings,
    })
}

/// Says at which steps the sides are compared, if these are not their ends or differ.
fn of_steps(steps: [u64; 2], ends: [u64; 2]) -> Option<String> {
    let ([a, b], [end_a, end_b]) = (both_in_words(steps), both_in_words(ends));
    if !are_alike(steps) {
        return Some(format!(
            "A and B were never evaluated at the same step: A is compared at step {a} and B at step {b}, where A ends at \
             {end_a} and B at {end_b}"
        ));
    }
    (steps != ends).then(|| {
        format!(
            "A ends at step {end_a} and B at step {end_b}: compared at step {a}, the last one at which all runs of both were \
             evaluated"
        )
    })
}

fn quotient([a, b]: [Option<f64>; 2]) -> Option<f64> {
    Some(b? / a?).filter(|quotient| quotient.is_finite())
}
