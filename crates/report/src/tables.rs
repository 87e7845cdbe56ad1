//! The tables of a report but for those of costs: final returns, agents, local simulators, and all runs.

use std::collections::BTreeSet;

use super::document::Table;
use super::finals::{AgentAt, Final};
use super::group::Comparison;
use super::paper;
use super::pictures::comparable;
use super::words::{certainty, difference, figure, figure_like, hours, signed, with_error};
use dials_session::records::method::steps_text;
use dials_session::records::run_record::{LikenessRecord, Status};

/// Stands where a cell has nothing.
pub(super) const NOTHING: &str = "-";

pub(super) fn words(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|&cell| cell.to_owned()).collect()
}

/// Columns of the table of final returns before the differences.
const BEFORE: [&str; 6] = ["method", "n", "steps", "episodes", "mean return", "95 % interval or seeds"];
/// Columns of the table of final returns after the differences.
const AFTER: [&str; 5] = ["median run", "median agent", "stuck agents", "paper", "ours − paper"];

/// Makes the table of final returns of one scenario, ours next to the paper's.
pub(crate) fn finals(comparison: &Comparison) -> Table {
    let scenario = &comparison.scenario;
    let opponents = comparison.opponents();
    let mut rows = Vec::new();
    for group in &comparison.groups {
        let Some(end) = Final::of(group) else { continue };
        let paper = paper::final_return(scenario, group.simulator(), group.method.retraining);
        let to_paper = paper.filter(|paper| comparable(end.steps, paper.steps));
        let to_paper = to_paper.map(|paper| signed(end.returns.mean - paper.mean, paper.mean));
        let paper =
            paper.map(|paper| format!("{} at {}", with_error(paper.mean, paper.std_error), steps_text(paper.steps)));
        let unfinished = if end.finished { "" } else { ", unfinished" };
        let mut row = vec![
            group.label(),
            end.returns.runs().to_string(),
            format!("{}{unfinished}", steps_text(end.steps)),
            episodes(&end),
            figure(end.returns.mean),
            certainty(&end.returns),
        ];
        let differences = opponents.iter().map(|opponent| opponent.difference(group, &end));
        row.extend(
            differences.map(|found| found.map_or(NOTHING.to_owned(), |found| difference(&found, end.returns.mean))),
        );
        row.extend([figure(end.median_run), figure(end.median_agent)]);
        row.push(format!("{} of {}", end.stuck.len(), end.agents));
        row.extend([paper, to_paper].map(|cell| cell.unwrap_or(NOTHING.to_owned())));
        rows.push(row);
    }
    let columns = BEFORE.len() + opponents.len() + AFTER.len();
    let blank = |row: &mut Vec<String>| row.resize(columns, NOTHING.to_owned());
    for baseline in &comparison.baselines {
        let mut row = words(&[&baseline.controller, NOTHING, NOTHING]);
        row.push(baseline.episodes.to_string());
        row.push(figure(baseline.mean_return));
        row.push(match baseline.episodes {
            // It has no standard error: one episode does not spread.
            ..2 => "one episode".to_owned(),
            episodes => {
                let error = figure_like(baseline.std_error, baseline.mean_return);
                format!("± {error} standard error over {episodes} episodes")
            }
        });
        blank(&mut row);
        row[columns - 2] = match (baseline.controller.as_str(), paper::hand_coded(scenario)) {
            ("actuated" | "oldest-item", Some(paper)) => figure(paper),
            ("random", _) => paper::start(scenario).map_or(NOTHING.to_owned(), figure),
            _ => NOTHING.to_owned(),
        };
        rows.push(row);
    }
    if let (true, Some(hand_coded)) = (comparison.baselines.is_empty(), paper::hand_coded(scenario)) {
        let mut row = words(&["hand-coded"]);
        blank(&mut row);
        row[columns - 2] = figure(hand_coded);
        rows.push(row);
    }
    let mut header = words(&BEFORE);
    header.extend(opponents.iter().map(|opponent| format!("− {}", opponent.name())));
    header.extend(words(&AFTER));
    Table { caption: caption_of_finals(comparison), header, rows }
}

fn caption_of_finals(comparison: &Comparison) -> String {
    let mut caption = format!(
        "Final return, {}. n: number of seeds. Five seeds or more: a 95 % Student's t interval over seeds. Fewer: the value of \
         each seed.",
        comparison.title
    );
    if !comparison.opponents().is_empty() {
        caption += " Differences are taken in every episode, averaged for each seed and shown like the returns. \"Other \
                    episodes\" marks a difference of means only.";
        if !comparison.baselines.is_empty() {
            caption += " The controller is the strongest one measured.";
        }
    }
    if comparison.scenario.rules.is_some()
        && let Some(rules) = comparison.rules()
    {
        caption += &format!(" Reward: {}.", rules.reward);
    }
    caption += &match paper::figure(&comparison.scenario) {
        Some(figure) => format!(" Paper: {figure}, ± its standard error where it draws one."),
        None => " The paper has no such scenario.".to_owned(),
    };
    caption
}

/// Writes the number of episodes: `100`, or `20 each` if seeds have different episodes.
fn episodes(end: &Final) -> String {
    let counts: Vec<String> = end.episode_counts().iter().map(usize::to_string).collect();
    end.episodes().map_or_else(|| format!("{} each", counts.join(" or ")), |episodes| episodes.count.to_string())
}

/// Makes the table of the agents of one scenario: the stuck ones, and the range of returns.
pub(crate) fn agents(comparison: &Comparison) -> Table {
    let rows = comparison.groups.iter().filter_map(|group| {
        let end = Final::of(group)?;
        let name =
            |agent: usize| group.runs.first().map_or_else(|| agent.to_string(), |run| run.about.agent_name(agent));
        let best = end.agents_of_runs.iter().flat_map(|(_, agents)| agents).map(|agent| agent.mean);
        // All with the same number of decimals.
        let figure = |value: f64| figure_like(value, end.returns.mean);
        Some(vec![
            group.label(),
            figure(end.returns.mean),
            figure(end.median_agent),
            format!(
                "{} (seed {}, agent {})",
                figure(end.worst_agent.mean_return),
                end.worst_agent.seed,
                name(end.worst_agent.agent)
            ),
            figure(best.fold(f64::NEG_INFINITY, f64::max)),
            stuck_agents(&end.stuck, &name),
        ])
    });
    Table {
        caption: format!(
            "Agents at the end, {}. The median agent is taken per run, then averaged over seeds.",
            comparison.title
        ),
        header: words(&["method", "mean", "median agent", "worst agent", "best agent", "stuck: seed (agents)"]),
        rows: rows.collect(),
    }
}

/// Makes the table of the local simulators of one scenario beside the global one (GS), if a run has recorded both.
pub(crate) fn likeness(comparison: &Comparison) -> Option<Table> {
    let rows: Vec<Vec<String>> = comparison
        .groups
        .iter()
        .filter_map(|group| {
            let runs: Vec<(&LikenessRecord, &LikenessRecord)> =
                group.runs.iter().filter_map(|run| Some((run.likeness.first()?, run.likeness.last()?))).collect();
            let mean = |figure: &dyn Fn(&LikenessRecord, &LikenessRecord) -> f64| {
                runs.iter().map(|(first, last)| figure(first, last)).sum::<f64>() / runs.len() as f64
            };
            let ratio = |[gs, ls]: [f64; 2]| if gs == ls { 1.0 } else { ls / gs.max(f64::MIN_POSITIVE) };
            let mut row = vec![group.label(), runs.len().to_string()];
            row.extend([0, 1].map(|place| format!("{:.1}", mean(&|_, last| last.cars[place]))));
            row.push(format!("{:.2}", mean(&|first, _| ratio(first.cars))));
            row.push(format!("{:.2}", mean(&|_, last| ratio(last.cars))));
            row.extend([0, 1].map(|place| format!("{:.1}", mean(&|_, last| last.speed_mps[place]))));
            row.push(format!("{:.2}", mean(&|first, _| ratio(first.speed_mps))));
            row.push(format!("{:.2}", mean(&|_, last| ratio(last.speed_mps))));
            (!runs.is_empty()).then_some(row)
        })
        .collect();
    let header = words(&[
        "method",
        "n",
        "cars GS",
        "cars LS",
        "LS / GS first",
        "LS / GS last",
        "m/s GS",
        "m/s LS",
        "LS / GS first",
        "LS / GS last",
    ]);
    let caption = format!(
        "Local simulators (LS) beside the global one (GS), {}: cars on the approaches of a light and their mean speed, in the \
         last evaluation and in the training before it. If LS / GS leaves 1 between the first and the last evaluation, the \
         local simulators have drifted away.",
        comparison.title
    );
    (!rows.is_empty()).then_some(Table { caption, header, rows })
}

/// Lists stuck agents by seed: `1 (0, 3), 2 (1)`.
fn stuck_agents(stuck: &[AgentAt], name: &dyn Fn(usize) -> String) -> String {
    let seeds: BTreeSet<u64> = stuck.iter().map(|agent| agent.seed).collect();
    let of_seed = |seed: u64| {
        let agents: Vec<String> =
            stuck.iter().filter(|agent| agent.seed == seed).map(|agent| name(agent.agent)).collect();
        format!("{seed} ({})", agents.join(", "))
    };
    match seeds.is_empty() {
        true => "none".to_owned(),
        false => seeds.into_iter().map(of_seed).collect::<Vec<_>>().join(", "),
    }
}

/// Makes the table of all runs with their progress.
pub(crate) fn runs(comparisons: &[Comparison]) -> Table {
    let mut rows = Vec::new();
    for comparison in comparisons {
        for group in &comparison.groups {
            for run in &group.runs {
                let last = run.evaluations.last();
                let status = match run.status() {
                    Status::Finished => "finished".to_owned(),
                    Status::Unfinished { .. } => format!("unfinished, at {}", steps_text(run.trained_to())),
                    Status::Empty => "begun".to_owned(),
                };
                let commit = run.about.versions.git_commit.as_str();
                let version = if commit.is_empty() { NOTHING } else { commit };
                rows.push(vec![
                    run.dir.display().to_string(),
                    comparison.title.clone(),
                    group.label(),
                    run.config.learning.seed.to_string(),
                    status,
                    last.map_or(NOTHING.to_owned(), |last| steps_text(last.steps)),
                    last.map_or(NOTHING.to_owned(), |last| last.episode_returns.len().to_string()),
                    last.map_or(NOTHING.to_owned(), |last| figure(last.all.mean)),
                    last.map_or(NOTHING.to_owned(), |last| last.all.stuck.to_string()),
                    run.total_time().map_or(NOTHING.to_owned(), |time| hours(time.runtime_s())),
                    run.total_time().map_or(NOTHING.to_owned(), |time| hours(time.cpu.runtime_s())),
                    run.workers.to_string(),
                    version.to_owned(),
                ]);
            }
        }
    }
    Table {
        caption: "Every run at its last evaluation. Hours: wall time and CPU time, without evaluations.".to_owned(),
        header: words(&[
            "run",
            "scenario",
            "method",
            "seed",
            "status",
            "evaluated at",
            "episodes",
            "return",
            "stuck",
            "hours",
            "CPU hours",
            "workers",
            "commit",
        ]),
        rows,
    }
}
