//! The tables of a report but for those of costs: final returns, agents, local simulators, and all runs.

use std::collections::BTreeSet;

use super::document::Table;
use super::finals::{AgentAt, Final};
use super::group::{Comparison, Group};
use super::paper;
use super::pictures::comparable;
use super::words::{certainty, difference, figure, figure_like, hours, signed, with_error};
use dials_session::records::method::steps_text;
use dials_session::records::run_record::{EvaluationRecord, LikenessRecord, PeriodTime, Status};

pub(super) const NOTHING: &str = "-";

pub(super) fn words(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|&cell| cell.to_owned()).collect()
}

fn or_nothing(cell: Option<String>) -> String {
    cell.unwrap_or(NOTHING.to_owned())
}

fn header(columns: &str) -> Vec<String> {
    columns.split(" | ").map(str::to_owned).collect()
}

/// Makes the table of final returns of one scenario, ours next to the paper's.
pub(crate) fn finals(comparison: &Comparison) -> Table {
    let scenario = &comparison.scenario;
    let opponents = comparison.opponents();
    let mut header = header("method | n | steps | episodes | mean return | 95 % interval or seeds");
    header.extend(opponents.iter().map(|opponent| format!("− {}", opponent.name())));
    header.extend(words(&["median run", "median agent", "stuck agents", "paper", "ours − paper"]));
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (group, end) in comparison.ends() {
        let unfinished = if end.finished { "" } else { ", unfinished" };
        let mut row = vec![
            group.label(),
            end.returns.runs().to_string(),
            format!("{}{unfinished}", steps_text(end.steps)),
            episodes(&end),
            figure(end.returns.mean),
            certainty(&end.returns),
        ];
        row.extend(opponents.iter().map(|opponent| {
            let found = opponent.difference(group, &end);
            or_nothing(found.map(|found| difference(&found, end.returns.mean)))
        }));
        row.extend([figure(end.median_run), figure(end.median_agent)]);
        row.push(format!("{} of {}", end.stuck.len(), end.agents));
        let paper = paper::final_return(scenario, group.simulator(), group.method.retraining);
        row.push(or_nothing(
            paper.map(|paper| format!("{} at {}", with_error(paper.mean, paper.std_error), steps_text(paper.steps))),
        ));
        let as_long = paper.filter(|paper| comparable(end.steps, paper.steps));
        row.push(or_nothing(as_long.map(|paper| signed(end.returns.mean - paper.mean, paper.mean))));
        rows.push(row);
    }
    let with_paper = |mut row: Vec<String>, paper: String| {
        row.resize(header.len() - 2, NOTHING.to_owned());
        row.extend([paper, NOTHING.to_owned()]);
        row
    };
    for baseline in &comparison.baselines {
        let certainty = match baseline.episodes {
            // It has no standard error: one episode does not spread.
            ..2 => "one episode".to_owned(),
            episodes => {
                let error = figure_like(baseline.std_error, baseline.mean_return);
                format!("± {error} standard error over {episodes} episodes")
            }
        };
        let mut row = words(&[&baseline.controller, NOTHING, NOTHING]);
        row.extend([baseline.episodes.to_string(), figure(baseline.mean_return), certainty]);
        let paper = match baseline.controller.as_str() {
            "actuated" | "oldest-item" => paper::hand_coded(scenario),
            "random" => paper::start(scenario),
            _ => None,
        };
        rows.push(with_paper(row, or_nothing(paper.map(figure))));
    }
    if let (true, Some(hand_coded)) = (comparison.baselines.is_empty(), paper::hand_coded(scenario)) {
        rows.push(with_paper(words(&["hand-coded"]), figure(hand_coded)));
    }
    // Only the paper's scenarios have columns for it.
    if paper::figure(scenario).is_none() {
        header.truncate(header.len() - 2);
        rows.iter_mut().for_each(|row| row.truncate(header.len()));
    }
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
    if let Some(figure) = paper::figure(&comparison.scenario) {
        caption += &format!(" Paper: {figure}, ± its standard error where it draws one.");
    }
    caption
}

/// Writes the number of episodes: `100`, or `20 each` if seeds have different episodes.
fn episodes(end: &Final) -> String {
    let each = || {
        let counts: BTreeSet<usize> = end.runs.iter().map(|(_, played)| played.episodes.count).collect();
        let counts: Vec<String> = counts.iter().map(usize::to_string).collect();
        format!("{} each", counts.join(" or "))
    };
    end.episodes().map_or_else(each, |episodes| episodes.count.to_string())
}

/// Makes the table of the agents of one scenario: the stuck ones, and the range of returns.
pub(crate) fn agents(comparison: &Comparison) -> Table {
    let rows = comparison.ends().into_iter().map(|(group, end)| {
        let name = |agent: usize| group.runs[0].about.agent_name(agent);
        let best = end.agents_of_runs.iter().flat_map(|(_, agents)| agents).map(|agent| agent.mean);
        // All with the same number of decimals.
        let figure = |value: f64| figure_like(value, end.returns.mean);
        let AgentAt { seed, agent, mean_return } = end.worst_agent;
        vec![
            group.label(),
            figure(end.returns.mean),
            figure(end.median_agent),
            format!("{} (seed {seed}, agent {})", figure(mean_return), name(agent)),
            figure(best.fold(f64::NEG_INFINITY, f64::max)),
            stuck_agents(&end.stuck, &name),
        ]
    });
    Table {
        caption: format!(
            "Agents {}, {}. The median agent is taken per run, then averaged over seeds.",
            comparison.when(),
            comparison.title
        ),
        header: words(&["method", "mean", "median agent", "worst agent", "best agent", "stuck: seed (agents)"]),
        rows: rows.collect(),
    }
}

/// Makes the table of the local simulators of one scenario beside the GS, if a run has recorded both.
pub(crate) fn likeness(comparison: &Comparison) -> Option<Table> {
    let row = |group: &Group| {
        let runs: Vec<(&LikenessRecord, &LikenessRecord)> =
            group.runs.iter().filter_map(|run| Some((run.likeness.first()?, run.likeness.last()?))).collect();
        let mean = |figure: &dyn Fn(&LikenessRecord, &LikenessRecord) -> f64| {
            runs.iter().map(|(first, last)| figure(first, last)).sum::<f64>() / runs.len() as f64
        };
        let ratio = |[gs, ls]: [f64; 2]| if gs == ls { 1.0 } else { ls / gs.max(f64::MIN_POSITIVE) };
        let cells = |pair: fn(&LikenessRecord) -> [f64; 2]| {
            let [gs, ls] = [0, 1].map(|place| format!("{:.1}", mean(&|_, last| pair(last)[place])));
            let [first, last] = [mean(&|first, _| ratio(pair(first))), mean(&|_, last| ratio(pair(last)))];
            [gs, ls, format!("{first:.2}"), format!("{last:.2}")]
        };
        let count = [group.label(), runs.len().to_string()];
        (!runs.is_empty()).then(|| [&count[..], &cells(|like| like.cars), &cells(|like| like.speed_mps)].concat())
    };
    let rows: Vec<Vec<String>> = comparison.groups.iter().filter_map(row).collect();
    let header = header(
        "method | n | cars GS | cars LS | LS / GS first | LS / GS last | m/s GS | m/s LS | LS / GS first | LS / GS last",
    );
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

pub(crate) fn runs(comparisons: &[Comparison]) -> Table {
    let all = || comparisons.iter().flat_map(|comparison| comparison.groups.iter().flat_map(|group| &group.runs));
    let with_python = all().any(|run| !run.about.python.is_empty());
    let mut rows = Vec::new();
    for comparison in comparisons {
        for (group, run) in comparison.groups.iter().flat_map(|group| group.runs.iter().map(move |run| (group, run))) {
            let status = match run.status() {
                Status::Finished => "finished".to_owned(),
                Status::Unfinished { .. } => format!("unfinished, at {}", steps_text(run.trained_to())),
                Status::Empty => "begun".to_owned(),
            };
            let commit = run.about.versions.git_commit.as_str();
            let last = |figure: fn(&EvaluationRecord) -> String| or_nothing(run.evaluations.last().map(figure));
            let time = |figure: fn(PeriodTime) -> f64| or_nothing(run.total_time().map(|time| hours(figure(time))));
            let mut row = vec![
                run.dir.display().to_string(),
                comparison.title.clone(),
                group.label(),
                run.config.learning.seed.to_string(),
                status,
                last(|last| steps_text(last.steps)),
                last(|last| last.episode_returns.len().to_string()),
                last(|last| figure(last.all.mean)),
                last(|last| last.all.stuck.to_string()),
                time(PeriodTime::runtime_s),
                time(|time| time.cpu.runtime_s()),
                run.workers.to_string(),
                if commit.is_empty() { NOTHING } else { commit }.to_owned(),
            ];
            if with_python {
                let parts: Vec<String> =
                    run.about.python.iter().map(|part| format!("{} {}", part.kind, part.name)).collect();
                row.push(if parts.is_empty() { NOTHING.to_owned() } else { parts.join(", ") });
            }
            rows.push(row);
        }
    }
    let in_python = if with_python { " | in Python" } else { "" };
    Table {
        caption: "Every run at its last evaluation. Hours: wall time and CPU time, without evaluations.".to_owned(),
        header: header(&format!(
            "run | scenario | method | seed | status | evaluated at | episodes | return | stuck | hours | CPU hours | \
             workers | commit{in_python}"
        )),
        rows,
    }
}
