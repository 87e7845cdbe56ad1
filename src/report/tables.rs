//! The tables of a report: final returns, agents, and runtimes and memory in the paper's layout.

use std::collections::BTreeSet;

use super::document::Table;
use super::finals::{AgentAt, Final, Runtime, peak_memory};
use super::group::{Comparison, Group, method_name, steps_text};
use super::paper::{self, PaperRuntime};
use super::pictures::comparable;
use super::run_dir::{Memory, Status};
use super::scenario::{Domain, Retraining};
use super::words::{figure, hours, interval, signed, with_error};

const NOTHING: &str = "-";

fn words(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|&cell| cell.to_owned()).collect()
}

/// Final returns of one scenario, the paper's beside ours.
pub fn finals(comparison: &Comparison) -> Table {
    let scenario = &comparison.scenario;
    let (domain, agents) = (scenario.domain, scenario.agents);
    let mut rows = Vec::new();
    for group in &comparison.groups {
        let Some(end) = Final::of(group) else { continue };
        let paper = paper::final_return(domain, agents, group.simulator(), group.method.retraining);
        let difference = paper.filter(|paper| comparable(end.steps, paper.steps)).map(|paper| {
            let difference = end.returns.mean - paper.mean;
            let error = end.returns.std_error.unwrap_or(0.0).hypot(paper.std_error.unwrap_or(0.0));
            let errors = if error > 0.0 { format!(" ({:.1} SE)", difference.abs() / error) } else { String::new() };
            format!("{}{errors}", signed(difference, paper.mean))
        });
        let paper =
            paper.map(|paper| format!("{} at {}", with_error(paper.mean, paper.std_error), steps_text(paper.steps)));
        let unfinished = if end.finished { "" } else { ", unfinished" };
        rows.push(vec![
            group.label(),
            end.returns.runs.to_string(),
            format!("{}{unfinished}", steps_text(end.steps)),
            with_error(end.returns.mean, end.returns.std_error),
            interval(end.returns.interval, end.returns.mean),
            figure(end.median_run),
            figure(end.median_agent),
            format!("{} of {}", end.stuck.len(), end.agents),
            paper.unwrap_or(NOTHING.to_owned()),
            difference.unwrap_or(NOTHING.to_owned()),
        ]);
    }
    let blank = |row: &mut Vec<String>| row.resize(10, NOTHING.to_owned());
    for baseline in &comparison.baselines {
        let mut row = words(&[&baseline.controller, NOTHING, NOTHING]);
        row.push(with_error(baseline.mean_return, Some(baseline.std_error)));
        blank(&mut row);
        row[8] = match (baseline.controller.as_str(), paper::hand_coded(domain, agents)) {
            ("actuated" | "oldest-item", Some(paper)) => figure(paper),
            ("random", _) => paper::start(domain, agents).map_or(NOTHING.to_owned(), figure),
            _ => NOTHING.to_owned(),
        };
        rows.push(row);
    }
    if let (true, Some(hand_coded)) = (comparison.baselines.is_empty(), paper::hand_coded(domain, agents)) {
        let mut row = words(&["hand-coded"]);
        blank(&mut row);
        row[8] = figure(hand_coded);
        rows.push(row);
    }
    let episodes = comparison.baselines.iter().map(|baseline| baseline.episodes.to_string()).collect::<BTreeSet<_>>();
    let of_baselines = match episodes.len() {
        0 => String::new(),
        _ => {
            let episodes = episodes.into_iter().collect::<Vec<_>>().join(", ");
            format!(" Of controllers: over {episodes} episodes.")
        }
    };
    Table {
        caption: format!(
            "Final return, {}. ±: standard error over seeds.{of_baselines} Paper: {}.",
            scenario.title(),
            paper::figure(domain, agents)
        ),
        header: words(&[
            "method",
            "runs",
            "steps",
            "mean return",
            "95 % bootstrap",
            "median run",
            "median agent",
            "stuck agents",
            "paper",
            "ours − paper",
        ]),
        rows,
    }
}

/// The agents of one scenario: who is lost, and how far the rest are apart.
pub fn agents(comparison: &Comparison) -> Table {
    let rows = comparison.groups.iter().filter_map(|group| {
        let end = Final::of(group)?;
        let best = end.agents_of_runs.iter().flat_map(|(_, agents)| agents).map(|agent| agent.mean);
        Some(vec![
            group.label(),
            figure(end.returns.mean),
            figure(end.median_agent),
            format!(
                "{} (seed {}, agent {})",
                figure(end.worst_agent.mean_return),
                end.worst_agent.seed,
                end.worst_agent.agent
            ),
            figure(best.fold(f64::NEG_INFINITY, f64::max)),
            stuck_agents(&end.stuck),
        ])
    });
    Table {
        caption: format!(
            "Agents at the end, {}. The median agent: of a run, then the mean over seeds.",
            comparison.scenario.title()
        ),
        header: words(&["method", "mean", "median agent", "worst agent", "best agent", "stuck: seed (agents)"]),
        rows: rows.collect(),
    }
}

/// `1 (0, 3), 2 (1)`
fn stuck_agents(stuck: &[AgentAt]) -> String {
    let seeds: BTreeSet<u64> = stuck.iter().map(|agent| agent.seed).collect();
    let of_seed = |seed: u64| {
        let agents: Vec<String> =
            stuck.iter().filter(|agent| agent.seed == seed).map(|agent| agent.agent.to_string()).collect();
        format!("{seed} ({})", agents.join(", "))
    };
    match seeds.is_empty() {
        true => "none".to_owned(),
        false => seeds.into_iter().map(of_seed).collect::<Vec<_>>().join(", "),
    }
}

/// A method that a row of the runtime table stands for.
type Row = (String, Retraining, String);

/// Runtimes of a domain in the paper's layout: agents training, influence, total, each by the number of agents.
pub fn runtimes(domain: Domain, comparisons: &[&Comparison]) -> Table {
    let sizes = sizes(comparisons);
    let rows = runtime_rows(comparisons).into_iter().map(|(simulator, retraining, label)| {
        let cells = |ours: fn(&Runtime) -> Option<f64>, theirs: fn(&PaperRuntime) -> Option<f64>| {
            let cell = |&agents: &usize| {
                let time = group_of(comparisons, agents, &label).and_then(Runtime::of);
                let short = time.is_some_and(|time| !comparable(time.steps, paper::STEPS));
                let time = time
                    .as_ref()
                    .and_then(ours)
                    .map(|seconds| format!("{}{}", hours(seconds), if short { "*" } else { "" }));
                let plain = label == method_name(&simulator, retraining);
                let paper = paper::runtime(domain, agents, &simulator, retraining).filter(|_| plain);
                beside(time, paper.as_ref().and_then(theirs).map(|hours| format!("{hours:.2}")))
            };
            sizes.iter().map(cell).collect::<Vec<_>>()
        };
        let mut row = vec![label.clone()];
        row.extend(cells(|time| Some(time.agents_training_s), |paper| Some(paper.agents_training)));
        row.extend(cells(|time| (time.influence_s > 0.0).then_some(time.influence_s), |paper| paper.influence));
        row.extend(cells(|time| Some(time.total_s), |paper| Some(paper.total)));
        row
    });
    let mut header = words(&["hours, ours / paper"]);
    for part in ["training", "influence", "total"] {
        header.extend(sizes.iter().map(|size| format!("{part}, {size}")));
    }
    let machine = machines(comparisons);
    Table {
        caption: format!(
            "Runtimes for {}: agents training, data collection and influence training, total, by number of agents; wall \
             time without evaluations, mean over seeds, {machine}. *: for fewer steps than the paper's 4M, see costs.csv. \
             Paper: {} (128 CPUs, one process per agent).",
            domain.name(),
            paper::RUNTIME_SOURCE
        ),
        header,
        rows: rows.collect(),
    }
}

/// How many workers the runs had.
fn machines(comparisons: &[&Comparison]) -> String {
    let groups = comparisons.iter().flat_map(|comparison| &comparison.groups);
    let workers: BTreeSet<usize> = groups.filter_map(|group| Some(Runtime::of(group)?.workers)).collect();
    let workers: Vec<String> = workers.iter().map(usize::to_string).collect();
    format!("with {} worker {}", workers.join(" or "), if workers == ["1"] { "process" } else { "processes" })
}

/// The paper's rows in its order, with ours among them.
fn runtime_rows(comparisons: &[&Comparison]) -> Vec<Row> {
    let paper = [
        ("gs", Retraining::Never),
        ("dials", Retraining::Every(100_000)),
        ("dials", Retraining::Every(500_000)),
        ("dials", Retraining::Every(1_000_000)),
        ("dials", Retraining::Every(4_000_000)),
        ("untrained-dials", Retraining::Never),
    ];
    let mut rows: Vec<Row> = paper
        .into_iter()
        .map(|(simulator, retraining)| (simulator.to_owned(), retraining, method_name(simulator, retraining)))
        .collect();
    for group in comparisons.iter().flat_map(|comparison| &comparison.groups) {
        let row = (group.simulator().to_owned(), group.method.retraining, group.label());
        if !rows.contains(&row) {
            rows.push(row);
        }
    }
    rows
}

fn sizes(comparisons: &[&Comparison]) -> Vec<usize> {
    let ours = comparisons.iter().map(|comparison| comparison.scenario.agents);
    ours.chain(paper::SIZES).collect::<BTreeSet<_>>().into_iter().collect()
}

fn group_of<'a>(comparisons: &[&'a Comparison], agents: usize, label: &str) -> Option<&'a Group> {
    let mut of_size = comparisons.iter().filter(|comparison| comparison.scenario.agents == agents);
    of_size.find_map(|comparison| comparison.groups.iter().find(|group| group.label() == label))
}

fn beside(ours: Option<String>, paper: Option<String>) -> String {
    match (ours, paper) {
        (None, None) => NOTHING.to_owned(),
        (ours, paper) => {
            format!("{} / {}", ours.unwrap_or(NOTHING.to_owned()), paper.unwrap_or(NOTHING.to_owned()))
        }
    }
}

/// Peak memory of a domain in the paper's layout.
pub fn memory(domain: Domain, comparisons: &[&Comparison]) -> Table {
    let sizes = sizes(comparisons);
    let ours = |agents: usize, simulator: &str| -> Option<Memory> {
        let of_size = comparisons.iter().filter(|comparison| comparison.scenario.agents == agents);
        let groups = of_size.flat_map(|comparison| &comparison.groups).filter(|group| group.simulator() == simulator);
        groups.filter_map(peak_memory).max_by(|a, b| a.total_mb.total_cmp(&b.total_mb))
    };
    let megabytes = |value: f64| format!("{value:.1}");
    let row = |label: &str, ours: &dyn Fn(usize) -> Option<f64>, theirs: &dyn Fn(usize) -> Option<f64>| {
        let cells = sizes.iter().map(|&agents| beside(ours(agents).map(megabytes), theirs(agents).map(megabytes)));
        std::iter::once(label.to_owned()).chain(cells).collect::<Vec<_>>()
    };
    let paper = |agents| paper::memory(domain, agents);
    let rows = vec![
        row("GS, total", &|agents| Some(ours(agents, "gs")?.total_mb), &|agents| Some(paper(agents)?.gs)),
        row("GS, total, shared pages once", &|agents| ours(agents, "gs")?.total_pss_mb, &|_| None),
        row("DIALS, per process", &|agents| Some(ours(agents, "dials")?.process_mb), &|agents| {
            Some(paper(agents)?.dials_process)
        }),
        row("DIALS, total", &|agents| Some(ours(agents, "dials")?.total_mb), &|agents| {
            Some(paper(agents)?.dials_total)
        }),
        row("DIALS, total, shared pages once", &|agents| ours(agents, "dials")?.total_pss_mb, &|_| None),
    ];
    let mut header = words(&["MB, ours / paper"]);
    header.extend(sizes.iter().map(|size| format!("{size} agents")));
    Table {
        caption: format!(
            "Peak memory for {} in MB, the largest of all runs; ours is the coordinator with {}, the paper's DIALS a \
             process per agent. Paper: {}.",
            domain.name(),
            machines(comparisons).trim_start_matches("with "),
            paper::MEMORY_SOURCE
        ),
        header,
        rows,
    }
}

/// Every run, with how far it came.
pub fn runs(comparisons: &[Comparison]) -> Table {
    let mut rows = Vec::new();
    for comparison in comparisons {
        for group in &comparison.groups {
            for run in &group.runs {
                let last = run.evaluations.last();
                let status = match run.status() {
                    Status::Finished => "finished",
                    Status::Unfinished { .. } => "unfinished",
                    Status::Empty => "begun",
                };
                let version = run.about["versions"]["git_commit"].as_str().unwrap_or(NOTHING);
                rows.push(vec![
                    run.dir.display().to_string(),
                    comparison.scenario.title(),
                    group.label(),
                    run.config.seed.to_string(),
                    status.to_owned(),
                    last.map_or(NOTHING.to_owned(), |last| steps_text(last.steps)),
                    last.map_or(NOTHING.to_owned(), |last| figure(last.all.mean)),
                    last.map_or(NOTHING.to_owned(), |last| last.all.stuck.to_string()),
                    run.total_time().map_or(NOTHING.to_owned(), |time| hours(time.runtime_s())),
                    run.workers.to_string(),
                    version.to_owned(),
                ]);
            }
        }
    }
    Table {
        caption: "Every run at its last evaluation.".to_owned(),
        header: words(&[
            "run", "scenario", "method", "seed", "status", "steps", "return", "stuck", "hours", "workers", "commit",
        ]),
        rows,
    }
}
