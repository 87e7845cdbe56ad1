//! The tables of a report: final returns, agents, and runtimes and memory in the paper's layout.

use std::collections::BTreeSet;

use super::document::Table;
use super::finals::{AgentAt, Final, Runtime, peak_memory};
use super::group::{Comparison, Group, method_name, steps_text};
use super::paper::{self, PaperRuntime};
use super::pictures::comparable;
use super::run_dir::{Memory, Status};
use super::scenario::{Domain, Scenario};
use super::words::{figure, hours, interval, signed, with_error};

const NOTHING: &str = "-";

fn words(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|&cell| cell.to_owned()).collect()
}

/// Final returns of one scenario, the paper's beside ours.
pub fn finals(comparison: &Comparison) -> Table {
    let scenario = &comparison.scenario;
    let mut rows = Vec::new();
    for group in &comparison.groups {
        let Some(end) = Final::of(group) else { continue };
        let paper = paper::final_return(scenario, group.simulator(), group.method.retraining);
        let difference = paper.filter(|paper| comparable(end.steps, paper.steps)).map(|paper| {
            let difference = end.returns.mean - paper.mean;
            let errors = standard_errors(difference, end.returns.std_error, paper.std_error);
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
        row[8] = match (baseline.controller.as_str(), paper::hand_coded(scenario)) {
            ("actuated" | "oldest-item", Some(paper)) => figure(paper),
            ("random", _) => paper::start(scenario).map_or(NOTHING.to_owned(), figure),
            _ => NOTHING.to_owned(),
        };
        rows.push(row);
    }
    if let (true, Some(hand_coded)) = (comparison.baselines.is_empty(), paper::hand_coded(scenario)) {
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
    let of_paper = match paper::has(scenario) {
        true => format!(
            " Paper: {}. SE: standard errors of the difference, from both; of our SE: where the paper draws none; nothing \
             where ours is unknown.",
            paper::figure(scenario)
        ),
        false => " The paper has no such scenario.".to_owned(),
    };
    Table {
        caption: format!("Final return, {}. ±: standard error over seeds.{of_baselines}{of_paper}", comparison.title),
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

/// How many standard errors a difference to the paper is; nothing where ours is not known.
fn standard_errors(difference: f64, ours: Option<f64>, papers: Option<f64>) -> String {
    let (error, whose) = match (ours, papers) {
        (Some(ours), Some(papers)) => (ours.hypot(papers), "SE"),
        (Some(ours), None) => (ours, "of our SE"),
        (None, _) => return String::new(),
    };
    if error > 0.0 { format!(" ({:.1} {whose})", difference.abs() / error) } else { String::new() }
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
            comparison.title
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

/// A column of a table by sizes: a scenario of ours, or one that only the paper has.
struct Column<'a> {
    scenario: Scenario,
    ours: Option<&'a Comparison>,
}

impl Column<'_> {
    fn name(&self) -> String {
        self.ours.map_or(self.scenario.agents.to_string(), Comparison::size)
    }
}

/// Ours and the paper's, by size.
fn columns<'a>(domain: Domain, comparisons: &[&'a Comparison]) -> Vec<Column<'a>> {
    let ours =
        comparisons.iter().map(|&comparison| Column { scenario: comparison.scenario.clone(), ours: Some(comparison) });
    let mut columns: Vec<Column> = ours.collect();
    for agents in paper::SIZES {
        if !columns.iter().any(|column| column.scenario.agents == agents && paper::has(&column.scenario)) {
            columns.push(Column { scenario: paper::scenario(domain, agents), ours: None });
        }
    }
    columns.sort_by_key(|column| column.scenario.agents);
    columns
}

/// Runtimes of a domain in the paper's layout: agents training, influence, total, each by the number of agents.
pub fn runtimes(domain: Domain, comparisons: &[&Comparison]) -> Table {
    let columns = columns(domain, comparisons);
    let ours: Vec<Vec<(String, Runtime)>> = columns
        .iter()
        .map(|column| column.ours.iter().flat_map(|comparison| &comparison.groups).filter_map(runtime_row).collect())
        .collect();
    let of_paper =
        paper::RUNTIMES.map(|(simulator, retraining)| (method_name(simulator, retraining), simulator, retraining));
    let mut labels: Vec<&String> = of_paper.iter().map(|(label, _, _)| label).collect();
    for (label, _) in ours.iter().flatten() {
        if !labels.contains(&label) {
            labels.push(label);
        }
    }
    let rows = labels.into_iter().map(|label| {
        let cells = |part: fn(&Runtime) -> Option<f64>, of_paper_part: fn(&PaperRuntime) -> Option<f64>| {
            let cell = |(column, ours): (&Column, &Vec<(String, Runtime)>)| {
                let time = ours.iter().find(|(own, _)| own == label).and_then(|(_, time)| part(time));
                let paper = of_paper.iter().find(|(own, _, _)| own == label);
                let paper = paper
                    .and_then(|(_, simulator, retraining)| paper::runtime(&column.scenario, simulator, *retraining));
                beside(time.map(hours), paper.as_ref().and_then(of_paper_part).map(|hours| format!("{hours:.2}")))
            };
            columns.iter().zip(&ours).map(cell).collect::<Vec<_>>()
        };
        let mut row = vec![label.clone()];
        row.extend(cells(|time| Some(time.agents_training_s), |paper| Some(paper.agents_training)));
        row.extend(cells(|time| (time.influence_s > 0.0).then_some(time.influence_s), |paper| paper.influence));
        row.extend(cells(|time| Some(time.total_s), |paper| Some(paper.total)));
        row
    });
    let mut header = words(&["hours, ours / paper"]);
    for part in ["training", "influence", "total"] {
        header.extend(columns.iter().map(|column| format!("{part}, {}", column.name())));
    }
    let machine = machines(comparisons);
    Table {
        caption: format!(
            "Runtimes for {}: agents training, data collection and influence training, total, by number of agents; wall \
             time without evaluations, mean over seeds, {machine}. What did not train for the paper's 4M steps has a row of \
             its own. Paper: {} (128 CPUs, one process per agent).",
            domain.name(),
            paper::RUNTIME_SOURCE
        ),
        header,
        rows: rows.collect(),
    }
}

/// The runtime of a group, and the row in which it stands: the paper's only if it trained for as many steps.
fn runtime_row(group: &Group) -> Option<(String, Runtime)> {
    let time = Runtime::of(group)?;
    let label = match (time.finished, comparable(time.steps, paper::STEPS)) {
        (true, true) => group.label(),
        (finished, _) => {
            let unfinished = if finished { "" } else { ", unfinished" };
            format!("{}, {} steps{unfinished}", group.label(), steps_text(time.steps))
        }
    };
    Some((label, time))
}

/// How many workers the runs had.
fn machines(comparisons: &[&Comparison]) -> String {
    let groups = comparisons.iter().flat_map(|comparison| &comparison.groups);
    let workers: BTreeSet<usize> = groups.filter_map(|group| Some(Runtime::of(group)?.workers)).collect();
    let workers: Vec<String> = workers.iter().map(usize::to_string).collect();
    format!("with {} worker {}", workers.join(" or "), if workers == ["1"] { "process" } else { "processes" })
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
    let columns = columns(domain, comparisons);
    let ours = |column: &Column, simulator: &str| -> Option<Memory> {
        let groups = column.ours.iter().flat_map(|comparison| &comparison.groups);
        let groups = groups.filter(|group| group.simulator() == simulator);
        groups.filter_map(peak_memory).max_by(|a, b| a.total_mb.total_cmp(&b.total_mb))
    };
    let megabytes = |value: f64| format!("{value:.1}");
    let row = |label: &str, ours: &dyn Fn(&Column) -> Option<f64>, theirs: &dyn Fn(&Column) -> Option<f64>| {
        let cells = columns.iter().map(|column| beside(ours(column).map(megabytes), theirs(column).map(megabytes)));
        std::iter::once(label.to_owned()).chain(cells).collect::<Vec<_>>()
    };
    let paper = |column: &Column| paper::memory(&column.scenario);
    let rows = vec![
        row("GS, total", &|column| Some(ours(column, "gs")?.total_mb), &|column| Some(paper(column)?.gs)),
        row("GS, total, shared pages once", &|column| ours(column, "gs")?.total_pss_mb, &|_| None),
        row("DIALS, per process", &|column| Some(ours(column, "dials")?.process_mb), &|column| {
            Some(paper(column)?.dials_process)
        }),
        row("DIALS, total", &|column| Some(ours(column, "dials")?.total_mb), &|column| {
            Some(paper(column)?.dials_total)
        }),
        row("DIALS, total, shared pages once", &|column| ours(column, "dials")?.total_pss_mb, &|_| None),
    ];
    let mut header = words(&["MiB, ours / MB, paper"]);
    header.extend(columns.iter().map(|column| format!("{} agents", column.name())));
    Table {
        caption: format!(
            "Peak memory for {}, the largest of all runs of a simulator, whatever else is set. Ours: MiB (1 MiB is 1.05 MB), the \
             coordinator with {}; the paper's: MB, DIALS as a process per agent. Paper: {}.",
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
                    comparison.title.clone(),
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
