//! A comparison of two groups of runs: final return, runtime, and the steps and time to reach a return.
//!
//! Returns are compared at the last step at which all runs of both groups were evaluated.
//! [`dials_core::base::statistics::difference`] takes the difference: by episode and by seed if both are the same. If one side
//! played more of the same episodes, both are compared on those of the other.
//!
//! - `steps`: the step at which each side is compared. `output`: the result for people and for programs.

mod output;
pub(super) mod steps;

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};

use self::steps::{are_alike, both_in_words, compared_at};
use super::finals::{agents_at, mean_cpu, played};
use super::group::{Comparison, Group, Sorted, evaluated_together, sort};
use super::words::{no_run, of_versions, warnings};
use dials_core::base::statistics::difference::{BySeed, Difference, between, on_shared, shared_episodes};
use dials_core::base::statistics::{ENOUGH_SEEDS, Spread, mean, median};
use dials_core::domain::ScenarioId;
use dials_core::outside::{Printable, quoted};
use dials_session::records::files::CONFIG;
use dials_session::records::find::{LeftOut, find};
use dials_session::records::method::differing;
use dials_session::records::run_record::{PeriodTime, RunRecord, Status};

/// How far the default return to reach is below the lower final return, as a share of its size.
const BELOW: f64 = 0.05;

/// One side of a comparison: runs of one method.
pub struct ComparedSide {
    name: String,
    scenario: ScenarioId,
    title: String,
    group: Group,
    left_out: Vec<LeftOut>,
}

impl ComparedSide {
    /// Reads the runs under these folders. Their configs may differ in the seed only.
    pub fn open(name: &str, folders: &[PathBuf]) -> Result<ComparedSide> {
        let sorted = sort(find(folders)?)?;
        let reasons = warnings(&sorted);
        let Sorted { mut comparisons, left_out, .. } = sorted;
        let of_comparison = |comparison: &Comparison| {
            let label = |group: &Group| format!("{}: {}", comparison.title, group.label());
            comparison.groups.iter().map(label).collect::<Vec<String>>()
        };
        let labels: Vec<String> = comparisons.iter().flat_map(of_comparison).collect();
        ensure!(
            labels.len() < 2,
            "{name}: holds runs of {} methods, but a side must have only one: {}",
            labels.len(),
            labels.join("; ")
        );
        let evaluated = comparisons.pop().filter(|found| found.groups.iter().any(|group| group.finals().is_some()));
        let comparison = evaluated.with_context(|| no_run(name, &reasons))?;
        let group = comparison.groups.into_iter().next().expect("the one that was counted");
        let (scenario, title) = (comparison.scenario, comparison.title);
        Ok(ComparedSide { name: name.to_owned(), scenario, title, group, left_out })
    }
}

/// What a side has at the step at which it is compared.
struct SideResult {
    /// Timesteps per agent.
    steps: u64,
    /// The runs that are compared, by seed, on the episodes that all of them played.
    runs: BySeed,
    returns: Spread,
    /// Return of the median agent of a run, mean over seeds.
    median_agent: f64,
    /// Number of stuck agents and of all agents, over all runs.
    stuck: (usize, usize),
    /// Mean wall and CPU seconds up to this step, without evaluations.
    runtime_s: Option<f64>,
    cpu_s: Option<f64>,
    /// Timesteps and wall seconds of each run that reached the return to reach.
    reached: Vec<(u64, Option<f64>)>,
}

impl SideResult {
    fn of(runs: &[&RunRecord], steps: u64, played: BySeed, target: f64) -> SideResult {
        let medians: Vec<f64> = runs.iter().filter_map(|run| Some(run.evaluation_at(steps)?.all.median)).collect();
        let agents = runs.iter().flat_map(|run| agents_at(run, steps));
        let runtimes: Option<Vec<f64>> = runs.iter().map(|run| run.runtime_at(steps)).collect();
        let times: Option<Vec<PeriodTime>> = runs.iter().map(|run| run.time_at(steps)).collect();
        let reached = runs.iter().filter_map(|run| {
            let first = run.evaluations.iter().find(|evaluation| evaluation.all.mean >= target)?.steps;
            Some((first, run.runtime_at(first)))
        });
        SideResult {
            steps,
            returns: Spread::of(&means(&played)).expect("a final return per run"),
            runs: played,
            median_agent: mean(&medians),
            stuck: agents.fold((0, 0), |(stuck, all), agent| (stuck + agent.stuck, all + 1)),
            runtime_s: runtimes.map(|runtimes| mean(&runtimes)),
            cpu_s: times.map(|times| mean_cpu(&times).runtime_s()),
            reached: reached.collect(),
        }
    }

    fn median_reached(&self) -> [Option<f64>; 2] {
        let steps: Vec<f64> = self.reached.iter().map(|(steps, _)| *steps as f64).collect();
        let seconds: Vec<f64> = self.reached.iter().filter_map(|(_, seconds)| *seconds).collect();
        [steps, seconds].map(|values| (!values.is_empty()).then(|| median(&values)))
    }
}

fn means(played: &BySeed) -> Vec<f64> {
    played.iter().map(|(_, played)| played.mean).collect()
}

pub struct Verdict {
    sides: [SideResult; 2],
    difference: Difference,
    target: f64,
    /// Keys of the configs that differ, with both values. `None`: this side does not use the key.
    differing: Vec<(String, [Option<String>; 2])>,
    warnings: Vec<String>,
}

/// Compares two sides. `target`: the return to reach; by default the lower final return minus 5 % of its size.
pub fn compare(a: &ComparedSide, b: &ComparedSide, target: Option<f64>) -> Result<Verdict> {
    let mut warnings: Vec<String> = check_rules(a, b)?.into_iter().collect();
    let sides = [a, b];
    let runs = sides.iter().flat_map(|side| &side.group.runs);
    warnings.extend(of_versions(runs.flat_map(|run| run.about.sumo())));
    let [(end_a, runs_a), (end_b, runs_b)] = sides.map(|side| side.group.finals().expect("a side was evaluated"));
    let (ends, runs) = ([end_a, end_b], [runs_a, runs_b]);
    let steps = compared_at(&evaluated_together(&runs[0]), &evaluated_together(&runs[1]));
    let steps = steps.expect("a side was evaluated");
    let played: [BySeed; 2] = [0, 1].map(|side| played(&runs[side], steps[side]));
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
    let [of_a, of_b] = played.map(|side| on_shared(&side, shared));
    let difference = between(&of_a, &of_b);
    let lower = mean(&means(&of_a)).min(mean(&means(&of_b)));
    let target = target.unwrap_or(lower - BELOW * lower.abs());
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
    let [on_a, on_b] = runs.each_ref().map(|runs| runs.iter().map(|run| run.workers).max().unwrap_or(1));
    if on_a != on_b {
        warnings.push(format!("A ran on {on_a} workers and B on {on_b}: their times are not comparable"));
    }
    let [n_a, n_b] = difference.seeds;
    if n_a.min(n_b) < ENOUGH_SEEDS {
        warnings.push(format!(
            "n = {n_a} in A and {n_b} in B: an interval needs {ENOUGH_SEEDS} seeds on each side; train more with --seed"
        ));
    }
    if !difference.pairing.by_episode() {
        warnings.push(
            "A and B were not evaluated on the same episodes, so the difference is over seeds only and includes the \
             randomness of the traffic; `evaluate` with the same --seed plays the same episodes"
                .to_owned(),
        );
    }
    Ok(Verdict {
        sides: [SideResult::of(&runs[0], steps[0], of_a, target), SideResult::of(&runs[1], steps[1], of_b, target)],
        difference,
        target,
        differing: differing(&a.group.method.keys, &b.group.method.keys),
        warnings,
    })
}

/// Returns warnings about what the agents of the sides see. Other scenarios, rewards or versions are an error.
fn check_rules(a: &ComparedSide, b: &ComparedSide) -> Result<Option<String>> {
    // The rules are the same for all runs of a side. A domain may name none.
    let rules = |side: &ComparedSide| side.group.runs.iter().find_map(|run| run.scenario().rules.clone());
    let mut differences = rules(a).zip(rules(b)).map_or(Vec::new(), |(of_a, of_b)| of_a.differences(&of_b, ["A", "B"]));
    if a.scenario == b.scenario {
        let warning = format!("A and B differ in more than their methods: {}", differences.join("; "));
        return Ok((!differences.is_empty()).then_some(warning));
    }
    // The checksum of a network of one's own covers the reward, too.
    let place = |side: &ComparedSide| ScenarioId { rules: None, checksum: None, ..side.scenario.clone() };
    ensure!(
        place(a) == place(b) && a.scenario.rules != b.scenario.rules,
        "{} is {} and {} is {}: returns of different scenarios (domain, agents, horizon, network) cannot be compared",
        a.name,
        a.scenario.word(),
        b.name,
        b.scenario.word()
    );
    if let (Some(of_a), Some(of_b)) = (&a.scenario.checksum, &b.scenario.checksum)
        && of_a != of_b
    {
        differences.push(format!("checksum of network and rules: {of_a} in A, {of_b} in B"));
    }
    let [of_a, of_b] = [a, b].map(|side| &side.group.runs[0].dir);
    bail!(
        "the returns of A and B are by different rules, so their difference means nothing\n  {}\nplay both by the same \
         rules on the same episodes, and compare other figures:\n  dials-traffic baseline {} --compare {},{}",
        differences.join("\n  "),
        quoted(&of_a.join(CONFIG)),
        quoted(of_a),
        quoted(of_b)
    )
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
