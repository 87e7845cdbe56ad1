//! What the episodes of controllers came to: tables for a person, JSON and CSV for programs.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use serde_json::{Map, Value, json};

use super::places;
use super::subject::Subject;
use crate::domain::Domain;
use crate::evaluation::{EpisodeReport, Evaluation, Interval, RETURN, figures};
use crate::records::csv::append;

/// A subject and the episodes that it played, which are the same for all subjects of a command.
pub struct Finding {
    pub subject: Subject,
    pub episodes: Vec<EpisodeReport>,
}

/// Values of all episodes by name.
type Figures = Vec<(String, Vec<f64>)>;

/// The widest line of a comparison.
const WIDTH: usize = 118;

/// One subject, with a line per agent.
pub fn table(domain: &dyn Domain, finding: &Finding) -> String {
    let evaluation = Evaluation::new(domain, &finding.episodes);
    let figures = figures(&finding.episodes);
    let ((name, returns), measures) = figures.split_first().expect("there is always a return");
    let (all, returns) = (evaluation.of_all(), Interval::of(returns));
    let mut lines = vec![format!(
        "{name} {:.1}{} (mean and 95 % interval over {} episodes), median of the agents {:.1}",
        returns.mean,
        returns.half_width.map_or(String::new(), |half_width| format!(" +- {half_width:.1}")),
        evaluation.episodes(),
        all.median
    )];
    for (name, values) in measures {
        let Interval { mean, half_width } = Interval::of(values);
        let half_width = half_width.map_or(String::new(), |half_width| format!(" +- {half_width:.2}"));
        lines.push(format!("{name:>24} {mean:.2}{half_width}"));
    }
    lines.push(String::new());
    let names: String = evaluation.measures.per_agent.iter().map(|(name, _)| format!(" {name}")).collect();
    lines.push(format!("{:>5} {:>8} {:>8} {:>8}{names} stuck", "agent", "return", "+-95%", "median"));
    for agent in 0..evaluation.agents() {
        let half_width = of_agent(&finding.episodes, agent).half_width;
        let measures = evaluation.measures.per_agent.iter();
        let measures: String =
            measures.map(|(name, values)| format!(" {:>width$.3}", values[agent], width = name.len())).collect();
        let of_agent = evaluation.of_agent(agent);
        lines.push(format!(
            "{agent:>5} {:>8.1} {:>8} {:>8.1}{measures} {:>5}",
            of_agent.mean,
            half_width.map_or("-".to_owned(), |half_width| format!("{half_width:.1}")),
            of_agent.median,
            if evaluation.stuck[agent] { "yes" } else { "no" }
        ));
    }
    lines.join("\n")
}

/// Several subjects, one line each, and their differences to the first of them, episode by episode.
pub fn comparison(findings: &[Finding]) -> String {
    let episodes = findings[0].episodes.len();
    let figures: Vec<Figures> = findings.iter().map(|finding| figures(&finding.episodes)).collect();
    let names: Vec<&str> = figures[0].iter().map(|(name, _)| name.as_str()).collect();
    let labels: Vec<String> = findings.iter().map(|finding| finding.subject.label()).collect();
    let means: Vec<Vec<String>> =
        figures.iter().map(|figures| figures.iter().map(|(_, values)| cell(Interval::of(values))).collect()).collect();
    let policies = findings.iter().find_map(|finding| match finding.subject {
        Subject::Run { greedy: true, .. } => Some(", greedy policies"),
        Subject::Run { greedy: false, .. } => Some(", sampled policies"),
        Subject::Controller(_) => None,
    });
    let policies = policies.unwrap_or_default();
    let title = format!("mean +- 95 % interval over {episodes} episodes, the same traffic for all{policies}");
    let mut text = format!("{title}\n{}", blocks(&names, &labels, &means));
    if let [reference, others @ ..] = &figures[..]
        && !others.is_empty()
    {
        // Of a figure in which nobody differs there is nothing to tell.
        let differs = |column: &usize| others.iter().any(|figures| figures[*column] != reference[*column]);
        let columns: Vec<usize> = (0..names.len()).filter(differs).collect();
        let names: Vec<&str> = columns.iter().map(|&column| names[column]).collect();
        let difference = |figures: &Figures, column: usize| {
            signed_cell(Interval::of_differences(&figures[column].1, &reference[column].1))
        };
        let differences: Vec<Vec<String>> =
            others.iter().map(|figures| columns.iter().map(|&column| difference(figures, column)).collect()).collect();
        let table = match columns.is_empty() {
            true => "no figure differs in any episode".to_owned(),
            false => blocks(&names, &labels[1..], &differences),
        };
        text += &format!("\n\nless {}, episode by episode\n{table}", labels[0]);
    }
    text
}

/// `215.7 +- 2.3`
fn cell(Interval { mean, half_width }: Interval) -> String {
    let digits = if mean.abs() < 20.0 { 2 } else { 1 };
    match half_width {
        // Of values that are all the same, or of a single one.
        None | Some(0.0) => format!("{mean:.digits$}"),
        Some(half_width) => format!("{mean:.digits$} +- {half_width:.digits$}"),
    }
}

/// `+3.41 +- 1.20`, for a difference.
fn signed_cell(interval: Interval) -> String {
    let cell = cell(interval);
    if cell.starts_with('-') { cell } else { format!("+{cell}") }
}

/// A table with a line per label, cut into as many tables side by side, one under the other, as lines of [`WIDTH`] need.
fn blocks(names: &[&str], labels: &[String], cells: &[Vec<String>]) -> String {
    let label_width = labels.iter().map(|label| label.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..names.len())
        .map(|column| cells.iter().map(|line| line[column].len()).chain([names[column].len()]).max().unwrap_or(0))
        .collect();
    let mut blocks = Vec::new();
    let mut begin = 0;
    while begin < names.len() {
        let mut end = begin;
        let mut width = label_width;
        while end < names.len() && (end == begin || width + 2 + widths[end] <= WIDTH) {
            width += 2 + widths[end];
            end += 1;
        }
        let line = |label: &str, cells: &[&str]| {
            let padding = " ".repeat(label_width - label.chars().count());
            let cells = cells.iter().zip(&widths[begin..end]).map(|(cell, width)| format!("  {cell:>width$}"));
            format!("{label}{padding}{}", cells.collect::<String>())
        };
        let mut lines = vec![line("", &names[begin..end])];
        for (label, cells) in labels.iter().zip(cells) {
            lines.push(line(label, &cells[begin..end].iter().map(String::as_str).collect::<Vec<_>>()));
        }
        blocks.push(lines.join("\n"));
        begin = end;
    }
    blocks.join("\n\n")
}

/// All figures of one subject.
pub fn to_json(domain: &dyn Domain, finding: &Finding) -> Map<String, Value> {
    let evaluation = Evaluation::new(domain, &finding.episodes);
    let all = evaluation.of_all();
    let figures = figures(&finding.episodes);
    let measures = &evaluation.measures;
    let per_agent = (0..evaluation.agents()).map(|agent| {
        let of_agent = evaluation.of_agent(agent);
        let mut object = Map::new();
        object.insert(RETURN.into(), json!(of_agent.mean));
        object.insert("mean_return".into(), json!(of_agent.mean));
        object.insert("median_return".into(), json!(of_agent.median));
        object.insert("std_error".into(), json!(of_agent.std_error));
        object.insert("half_width_95".into(), json!(self::of_agent(&finding.episodes, agent).half_width));
        object.insert("stuck".into(), json!(evaluation.stuck[agent]));
        object.extend(measures.per_agent.iter().map(|(name, values)| (name.clone(), json!(values[agent]))));
        Value::Object(object)
    });
    let mut object: Map<String, Value> =
        finding.subject.keys().into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    object.insert(RETURN.into(), json!(all.mean));
    object.insert("mean_return".into(), json!(all.mean));
    object.insert("median_return".into(), json!(all.median));
    object.insert("std_error".into(), json!(all.std_error));
    object.insert("episodes".into(), json!(evaluation.episodes()));
    object.insert("episode_returns".into(), json!(figures[0].1));
    object.insert("agents".into(), json!(evaluation.agents()));
    object.insert("stuck_agents".into(), json!(evaluation.stuck.iter().filter(|&&stuck| stuck).count()));
    object.extend(measures.system.iter().map(|(name, value)| (name.clone(), json!(value))));
    let half_widths = figures.iter().map(|(name, values)| (name.clone(), json!(Interval::of(values).half_width)));
    object.insert("half_width_95".into(), Value::Object(half_widths.collect()));
    object.insert("per_agent".into(), per_agent.collect());
    object
}

/// All figures of several subjects, and their differences to the first of them.
pub fn comparison_to_json(domain: &dyn Domain, findings: &[Finding]) -> Map<String, Value> {
    let reference = figures(&findings[0].episodes);
    let differences = findings[1..].iter().map(|finding| {
        let mut object = Map::new();
        object.insert("of".into(), json!(finding.subject.label()));
        object.insert("less".into(), json!(findings[0].subject.label()));
        for ((name, values), (_, reference)) in figures(&finding.episodes).iter().zip(&reference) {
            let Interval { mean, half_width } = Interval::of_differences(values, reference);
            object.insert(name.clone(), json!({ "mean": mean, "half_width_95": half_width }));
        }
        Value::Object(object)
    });
    let mut object = Map::new();
    object.insert("differences".into(), differences.collect());
    object
        .insert("controllers".into(), findings.iter().map(|finding| Value::Object(to_json(domain, finding))).collect());
    object
}

fn of_agent(episodes: &[EpisodeReport], agent: usize) -> Interval {
    Interval::of(&episodes.iter().map(|episode| episode.returns[agent]).collect::<Vec<_>>())
}

/// The CSV files of `--csv`: they get the lines of a subject as soon as it has played.
pub struct CsvFiles {
    episodes: PathBuf,
    agents: PathBuf,
}

impl CsvFiles {
    /// Makes the directory; files that are there already are an error, and so is a place that cannot be written to.
    pub fn create(dir: &Path) -> Result<CsvFiles> {
        let files = CsvFiles { episodes: dir.join("episodes.csv"), agents: dir.join("agents.csv") };
        for file in [&files.episodes, &files.agents] {
            ensure!(!file.exists(), "{}: exists already; move it away or name another directory", file.display());
        }
        places::check_writable(dir)?;
        Ok(files)
    }

    pub fn append(&self, finding: &Finding) -> Result<()> {
        let label = finding.subject.label();
        let figures = figures(&finding.episodes);
        let names = |fixed: &[&str], names: Vec<String>| -> Vec<String> {
            fixed.iter().map(|&name| name.to_owned()).chain(names).collect()
        };
        let header = names(&["controller", "episode"], figures.iter().map(|(name, _)| name.clone()).collect());
        let lines = (0..finding.episodes.len()).map(|episode| {
            let values = figures.iter().map(|(_, values)| values[episode].to_string());
            [label.clone(), episode.to_string()].into_iter().chain(values).collect()
        });
        append(&self.episodes, &header, &lines.collect::<Vec<_>>())?;

        let measures = &finding.episodes[0].measures.per_agent;
        let header = names(
            &["controller", "episode", "agent", "return"],
            measures.iter().map(|(name, _)| name.clone()).collect(),
        );
        let mut lines = Vec::new();
        for (number, episode) in finding.episodes.iter().enumerate() {
            for (agent, of_agent) in episode.returns.iter().enumerate() {
                let values = episode.measures.per_agent.iter().map(|(_, values)| values[agent].to_string());
                let place = [label.clone(), number.to_string(), agent.to_string(), of_agent.to_string()];
                lines.push(place.into_iter().chain(values).collect());
            }
        }
        append(&self.agents, &header, &lines)
    }
}
