//! A comparison of two groups of runs: final return, runtime, and the steps and time to reach a return.
//!
//! Returns are compared at the same number of timesteps: the last one that both groups reached.
//! [`crate::base::statistics::difference`] takes the difference: by episode and by seed if both are the same.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use serde_json::{Value, json};

use super::finals::{agents_at, mean_cpu};
use super::find::{LeftOut, find};
use super::group::{Group, Sorted, sort, steps_text};
use super::played;
use super::words::{duration, figure, figure_like, interval, no_run, pairing, signed, signed_interval, warnings};
use crate::base::counted;
use crate::base::statistics::difference::{BySeed, Difference, between, common_episodes};
use crate::base::statistics::{ENOUGH_SEEDS, Spread, mean, median};
use crate::domain::ScenarioId;
use crate::outside::Printable;
use crate::records::run_record::{CpuTime, PeriodTime, RunRecord, Status};

/// Default return to reach, as a share of the lower final return.
const REACH: f64 = 0.95;

/// One side of a comparison: runs of one method.
pub struct ComparedSide {
    /// Its name on the command line.
    pub name: String,
    pub scenario: ScenarioId,
    pub group: Group,
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
        let comparison = comparisons.pop().with_context(|| no_run(name, &warnings(&[], &missing, &left_out)))?;
        let group = comparison.groups.into_iter().next().expect("the one that was counted");
        ensure!(group.finals().is_some(), "{name}: has no run that was evaluated yet");
        Ok(ComparedSide { name: name.to_owned(), scenario: comparison.scenario, group, left_out })
    }
}

/// Steps and time that a side needed to reach a return.
pub struct Reached {
    /// Seed, timesteps and seconds of each run that reached it.
    pub runs: Vec<(u64, u64, Option<f64>)>,
    /// Number of all runs.
    pub of: usize,
}

impl Reached {
    /// Finds the first evaluation of each run with at least this mean return.
    fn of(runs: &[&RunRecord], target: f64) -> Reached {
        let first = |run: &&RunRecord| {
            let steps = run.evaluations.iter().find(|evaluation| evaluation.all.mean >= target)?.steps;
            Some((run.config.seed, steps, run.runtime_at(steps)))
        };
        Reached { runs: runs.iter().filter_map(first).collect(), of: runs.len() }
    }

    /// Median timesteps of the runs that reached it.
    pub fn steps(&self) -> Option<f64> {
        let steps: Vec<f64> = self.runs.iter().map(|(_, steps, _)| *steps as f64).collect();
        (!steps.is_empty()).then(|| median(&steps))
    }

    /// Median seconds of the runs that reached it.
    pub fn seconds(&self) -> Option<f64> {
        let seconds: Vec<f64> = self.runs.iter().filter_map(|(_, _, seconds)| *seconds).collect();
        (!seconds.is_empty()).then(|| median(&seconds))
    }
}

/// The result of comparing `b` with `a`.
pub struct Verdict {
    /// Timesteps per agent at which the returns are compared.
    pub steps: u64,
    pub returns: [Spread; 2],
    /// The runs that are compared, by seed.
    pub runs: [BySeed; 2],
    /// Return of the median agent of a run, mean over seeds.
    pub median_agents: [f64; 2],
    /// Number of stuck agents and of all agents, over all runs.
    pub stuck: [(usize, usize); 2],
    pub difference: Difference,
    /// Mean wall seconds up to these timesteps, without evaluations.
    pub runtimes: [Option<f64>; 2],
    /// Mean CPU seconds up to these timesteps.
    pub cpu: [Option<CpuTime>; 2],
    /// Return to reach.
    pub target: f64,
    pub reached: [Reached; 2],
    /// Keys of the configs that differ, with both values. `None`: this side does not use the key.
    pub differing: Vec<(String, [Option<String>; 2])>,
    pub warnings: Vec<String>,
}

/// Compares two sides. `target`: the return to reach; by default 95 % of the lower final return.
pub fn compare(a: &ComparedSide, b: &ComparedSide, target: Option<f64>) -> Result<Verdict> {
    ensure!(
        a.scenario == b.scenario,
        "{} is {} and {} is {}: returns of different scenarios (domain, agents, horizon, network) cannot be compared",
        a.name,
        a.scenario.word(),
        b.name,
        b.scenario.word()
    );
    let sides = [a, b];
    let [(steps_a, runs_a), (steps_b, runs_b)] = sides.map(|side| side.group.finals().expect("a side was evaluated"));
    let steps = steps_a.min(steps_b);
    let runs = [runs_a, runs_b];
    let played = runs.each_ref().map(|runs| {
        let played = runs.iter().filter_map(|run| Some((run.config.seed, played::of_run(run, steps)?)));
        played.collect::<BySeed>()
    });
    let returns = played.each_ref().map(|side| side.iter().map(|(_, played)| played.mean).collect::<Vec<f64>>());
    let found = between(&played[0], &played[1]);
    let median_agents =
        runs.each_ref().map(|runs| mean(&runs.iter().filter_map(|run| run.median_at(steps)).collect::<Vec<_>>()));
    let stuck = runs.each_ref().map(|runs| {
        let agents = runs.iter().flat_map(|run| agents_at(run, steps));
        agents.fold((0, 0), |(stuck, all), agent| (stuck + agent.stuck, all + 1))
    });
    let means = returns.each_ref().map(|returns| mean(returns));
    let target = target.unwrap_or(REACH * means[0].min(means[1]));
    let runtimes = runs.each_ref().map(|runs| {
        let times: Vec<f64> = runs.iter().filter_map(|run| run.runtime_at(steps)).collect();
        (times.len() == runs.len()).then(|| mean(&times))
    });
    let cpu = runs.each_ref().map(|runs| {
        let times: Option<Vec<PeriodTime>> = runs.iter().map(|run| run.time_at(steps)).collect();
        mean_cpu(&times?)
    });
    let mut warnings = Vec::new();
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
    if steps_a != steps_b {
        let [a, b] = [steps_a, steps_b].map(steps_text);
        warnings.push(format!("A ends at {a} steps and B at {b}: compared at {}", steps_text(steps)));
    }
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

/// Returns the keys whose values differ, in order. `None`: this side has no such key.
pub fn differing(a: &BTreeMap<String, String>, b: &BTreeMap<String, String>) -> Vec<(String, [Option<String>; 2])> {
    let mut keys: Vec<&String> = a.keys().chain(b.keys()).collect();
    keys.sort();
    keys.dedup();
    let differing = keys.into_iter().filter(|key| a.get(*key) != b.get(*key));
    differing.map(|key| (key.clone(), [a.get(key).cloned(), b.get(key).cloned()])).collect()
}

impl Verdict {
    /// Writes the comparison as text.
    pub fn to_text(&self, a: &ComparedSide, b: &ComparedSide) -> String {
        let mut lines = Vec::new();
        for ((letter, side), runs) in [("A", a), ("B", b)].into_iter().zip(&self.runs) {
            let seeds: Vec<String> = runs.iter().map(|(seed, _)| seed.to_string()).collect();
            let on = common_episodes(runs.iter().map(|(_, played)| played)).map_or(String::new(), |on| {
                format!(" ({} of evaluation.seed {})", counted(on.count, "episode"), on.seed)
            });
            lines.push(format!("{letter}: {}: {}, seed {}{on}", side.name, side.group.name(), seeds.join(", ")));
        }
        // Keys that only one side uses follow from the simulator, which has a line of its own.
        let both = self.differing.iter().filter_map(|(key, [a, b])| Some((key, a.as_ref()?, b.as_ref()?)));
        lines.extend(both.map(|(key, a, b)| Printable(format!("   {key}: {a} in A, {b} in B")).to_string()));
        lines.push(format!("{}, at {} timesteps per agent", a.scenario.title(), steps_text(self.steps)));
        lines.push(String::new());
        let row = |what: &str, a: String, b: String, both: String| format!("{what:<24}{a:>20}{b:>20}   {both}");
        lines.push(row("", "A".to_owned(), "B".to_owned(), "B against A".to_owned()));
        let like = self.returns[0].mean;
        let [of_a, of_b] = self.returns.each_ref().map(|spread| figure(spread.mean));
        lines.push(row("mean return", of_a, of_b, signed(self.difference.mean, like)));
        if self.returns.iter().any(|spread| spread.interval.is_some()) {
            let [of_a, of_b] = self.returns.each_ref().map(|spread| interval(spread.interval, like));
            let of_both = self.difference.interval.map_or("-".to_owned(), |ends| signed_interval(ends, like));
            lines.push(row("  95 % interval", of_a, of_b, of_both));
        }
        if self.difference.interval.is_none() {
            lines.extend(self.seeds().map(|(seed, values, difference)| {
                let [of_a, of_b] = values.map(|value| value.map_or("-".to_owned(), |value| figure_like(value, like)));
                let difference = difference.map_or(String::new(), |value| signed(value, like));
                row(&format!("  seed {seed}"), of_a, of_b, difference)
            }));
        }
        let [a_median, b_median] = self.median_agents;
        let median_difference = signed(b_median - a_median, a_median);
        lines.push(row("median agent", figure(a_median), figure(b_median), median_difference));
        let [of_a, of_b] = self.stuck.map(|(stuck, all)| format!("{stuck} of {all}"));
        lines.push(row("stuck agents", of_a, of_b, String::new()));
        let [of_a, of_b] = self.runtimes.map(|seconds| seconds.map_or("-".to_owned(), duration));
        lines.push(row("runtime", of_a, of_b, ratio(self.runtimes)));
        let cpu = self.cpu.map(|cpu| cpu.map(CpuTime::runtime_s));
        let [of_a, of_b] = cpu.map(|seconds| seconds.map_or("-".to_owned(), duration));
        lines.push(row("CPU time", of_a, of_b, ratio(cpu)));
        let target = figure(self.target);
        let steps = self.reached.each_ref().map(Reached::steps);
        let [of_a, of_b] = self.reached.each_ref().map(|reached| {
            let steps = reached.steps().map_or("-".to_owned(), |steps| steps_text(steps as u64));
            format!("{steps} ({} of {})", reached.runs.len(), reached.of)
        });
        lines.push(row(&format!("steps to reach {target}"), of_a, of_b, ratio(steps)));
        let seconds = self.reached.each_ref().map(Reached::seconds);
        let [of_a, of_b] = seconds.map(|seconds| seconds.map_or("-".to_owned(), duration));
        lines.push(row(&format!("time to reach {target}"), of_a, of_b, ratio(seconds)));
        lines.push(String::new());
        let interval = self.returns.iter().any(|spread| spread.interval.is_some());
        let interval = if interval { "; intervals: Student's t over seeds" } else { "" };
        lines.push(format!("returns: {}{interval}", pairing(self.difference.pairing)));
        lines.push(
            "runtime: wall time; CPU time: all processes; both without evaluations; steps and time to reach: median of \
             the runs that reached it"
                .to_owned(),
        );
        lines.extend(self.warnings.iter().map(|warning| format!("warning: {warning}")));
        lines.join("\n")
    }

    /// Returns all seeds with the return of each side and their difference.
    fn seeds(&self) -> impl Iterator<Item = (u64, [Option<f64>; 2], Option<f64>)> + '_ {
        let seeds: BTreeSet<u64> = self.runs.iter().flatten().map(|(seed, _)| *seed).collect();
        seeds.into_iter().map(|seed| {
            let value = |side: &BySeed| side.iter().find(|(own, _)| *own == seed).map(|(_, played)| played.mean);
            let difference = self.difference.of_seeds.iter().find(|(own, _)| *own == seed).map(|(_, value)| *value);
            (seed, self.runs.each_ref().map(value), difference)
        })
    }

    /// Writes the comparison as JSON.
    pub fn to_json(&self, a: &ComparedSide, b: &ComparedSide) -> Value {
        let side = |index: usize, side: &ComparedSide| {
            let (returns, reached) = (&self.returns[index], &self.reached[index]);
            let episodes = common_episodes(self.runs[index].iter().map(|(_, played)| played));
            json!({
                "name": side.name,
                "method": side.group.name(),
                "seeds": self.runs[index].iter().map(|(seed, _)| *seed).collect::<Vec<u64>>(),
                "runs": returns.runs(),
                "mean_return": returns.mean,
                "returns": returns.values,
                "interval_95": returns.interval.map(|interval| [interval.low, interval.high]),
                "evaluation_seed": episodes.map(|episodes| episodes.seed),
                "episodes": episodes.map(|episodes| episodes.count),
                "median_agent": self.median_agents[index],
                "stuck_agents": self.stuck[index].0,
                "agents": self.stuck[index].1,
                "runtime_s": self.runtimes[index],
                "cpu_s": self.cpu[index].map(CpuTime::runtime_s),
                "reached_runs": reached.runs.len(),
                "reached_steps": reached.steps(),
                "reached_s": reached.seconds(),
            })
        };
        json!({
            "scenario": a.scenario.word(),
            "steps": self.steps,
            "a": side(0, a),
            "b": side(1, b),
            "difference": self.difference.mean,
            "interval_95": self.difference.interval.map(|interval| [interval.low, interval.high]),
            "paired_by": self.difference.pairing.name(),
            "differences": self.difference.of_seeds.iter().map(|(seed, value)| json!({ "seed": seed, "difference": value })).collect::<Vec<_>>(),
            "runtime_ratio": quotient(self.runtimes),
            "cpu_ratio": quotient(self.cpu.map(|cpu| cpu.map(CpuTime::runtime_s))),
            "reach": self.target,
            "differing": self.differing.iter().map(|(key, values)| (key.clone(), json!(values))).collect::<serde_json::Map<_, _>>(),
            "warnings": self.warnings,
        })
    }
}

fn quotient([a, b]: [Option<f64>; 2]) -> Option<f64> {
    Some(b? / a?).filter(|quotient| quotient.is_finite())
}

fn ratio(values: [Option<f64>; 2]) -> String {
    quotient(values).map_or("-".to_owned(), |quotient| format!("x {quotient:.2}"))
}
