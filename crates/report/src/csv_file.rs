//! The numbers of a report as CSV files.

use anyhow::{Context, Result};

use super::curves::{LossData, learning_curve, loss_curve};
use super::finals::{Final, Runtime, peak_memory};
use super::group::{Comparison, Group};
use dials_core::base::statistics::Spread;
use dials_core::outside::csv_name;
use dials_session::records::run_record::MemoryRecord;

/// A file of the report.
pub(crate) struct CsvFile {
    pub(crate) name: &'static str,
    pub(crate) text: String,
}

/// Returns all CSV files.
pub(crate) fn files(comparisons: &[Comparison]) -> Result<Vec<CsvFile>> {
    Ok(vec![
        curves(comparisons)?,
        losses(comparisons)?,
        finals(comparisons)?,
        differences(comparisons)?,
        seeds(comparisons)?,
        agents(comparisons)?,
        costs(comparisons)?,
    ])
}

fn curves(comparisons: &[Comparison]) -> Result<CsvFile> {
    let header = ["steps", "runs", "mean", "std_error", "low95", "high95", "median_agent", "runtime_s"];
    write("curves.csv", &header, comparisons, |_, group| {
        let points = learning_curve(group).into_iter().map(|point| {
            let mut line = vec![point.steps.to_string()];
            line.extend(spread(&point.returns));
            line.extend([number(point.median_agent), optional(point.runtime_s)]);
            line
        });
        points.collect()
    })
}

fn losses(comparisons: &[Comparison]) -> Result<CsvFile> {
    let header = ["steps", "when", "runs", "cross_entropy", "std_error", "low95", "high95", "marginals"];
    write("aip_cross_entropy.csv", &header, comparisons, |_, group| {
        let (data, points) = loss_curve(group);
        let points = points.into_iter().map(|point| {
            let when = match (point.after_training, data) {
                (true, _) => "after training",
                (false, LossData::Fresh) => "evaluation",
                (false, LossData::HeldOut) => "before training",
            };
            let mut line = vec![point.steps.to_string(), when.to_owned()];
            line.extend(spread(&point.loss));
            line.push(number(point.marginals));
            line
        });
        points.collect()
    })
}

fn finals(comparisons: &[Comparison]) -> Result<CsvFile> {
    let header = [
        "steps",
        "finished",
        "runs",
        "episodes",
        "mean",
        "std_error",
        "low95",
        "high95",
        "median_run",
        "median_agent",
        "worst_agent",
        "stuck_agents",
        "agents",
    ];
    write("final.csv", &header, comparisons, |_, group| {
        let line = Final::of(group).map(|end| {
            let mut line = vec![end.steps.to_string(), end.finished.to_string()];
            let [runs, figures @ ..] = spread(&end.returns);
            let episodes = end.episodes().map_or(String::new(), |episodes| episodes.count.to_string());
            line.extend([runs, episodes]);
            line.extend(figures);
            line.extend([end.median_run, end.median_agent, end.worst_agent.mean_return].map(number));
            line.extend([end.stuck.len(), end.agents].map(|count| count.to_string()));
            line
        });
        line.into_iter().collect()
    })
}

/// Writes the differences of final returns: one line for all seeds, then one per seed.
fn differences(comparisons: &[Comparison]) -> Result<CsvFile> {
    let header = ["against", "paired_by", "seed", "difference", "low95", "high95"];
    write("differences.csv", &header, comparisons, |comparison, group| {
        let Some(end) = Final::of(group) else { return Vec::new() };
        let found = comparison.opponents().into_iter().filter_map(|opponent| {
            let found = opponent.difference(group, &end)?;
            let place = [csv_name(opponent.name()), found.pairing.name().to_owned()];
            let (low, high) = (found.interval.map(|ends| ends.low), found.interval.map(|ends| ends.high));
            let all = ["all".to_owned(), number(found.mean), optional(low), optional(high)];
            let of_seeds = found.of_seeds.iter();
            let of_seeds =
                of_seeds.map(|(seed, value)| [seed.to_string(), number(*value), String::new(), String::new()]);
            let lines = std::iter::once(all).chain(of_seeds).map(|line| place.iter().cloned().chain(line).collect());
            Some(lines.collect::<Vec<Vec<String>>>())
        });
        found.flatten().collect()
    })
}

/// Writes the learning curve of every seed.
fn seeds(comparisons: &[Comparison]) -> Result<CsvFile> {
    let header = ["seed", "steps", "episodes", "mean", "median_agent", "runtime_s"];
    write("seeds.csv", &header, comparisons, |_, group| {
        let lines = group.runs.iter().flat_map(|run| {
            run.evaluations.iter().map(|evaluation| {
                let episodes = evaluation.episode_returns.len().to_string();
                let mut line = vec![run.config.learning.seed.to_string(), evaluation.steps.to_string(), episodes];
                line.extend([evaluation.all.mean, evaluation.all.median].map(number));
                line.push(optional(run.runtime_at(evaluation.steps)));
                line
            })
        });
        lines.collect()
    })
}

fn agents(comparisons: &[Comparison]) -> Result<CsvFile> {
    let header = ["seed", "steps", "agent", "mean", "median", "std_error", "stuck"];
    write("agents.csv", &header, comparisons, |_, group| {
        let Some(end) = Final::of(group) else { return Vec::new() };
        let lines = end.agents_of_runs.iter().flat_map(|(seed, agents)| {
            agents.iter().enumerate().map(|(agent, returns)| {
                let mut line = vec![seed.to_string(), end.steps.to_string(), agent.to_string()];
                line.extend([returns.mean, returns.median, returns.std_error].map(number));
                line.push(returns.stuck.to_string());
                line
            })
        });
        lines.collect()
    })
}

fn costs(comparisons: &[Comparison]) -> Result<CsvFile> {
    let header = [
        "steps",
        "finished",
        "workers",
        "agents_training_s",
        "influence_s",
        "total_s",
        "total_low95_s",
        "total_high95_s",
        "wall_s",
        "cpu_s",
        "cpu_evaluation_s",
        "peak_process_mb",
        "peak_total_mb",
        "peak_total_pss_mb",
    ];
    write("costs.csv", &header, comparisons, |_, group| {
        let line = Runtime::of(group).map(|time| {
            let memory = peak_memory(group);
            let mut line = vec![time.steps.to_string(), time.finished.to_string(), time.workers.to_string()];
            line.extend([time.agents_training_s, time.influence_s, time.total.mean].map(number));
            let ends = time.total.interval;
            line.extend([ends.map(|ends| ends.low), ends.map(|ends| ends.high)].map(optional));
            line.push(number(time.wall_s));
            line.extend([time.cpu.total_s, time.cpu.evaluation_s].map(number));
            type Part = fn(MemoryRecord) -> f64;
            let parts: [Part; 3] = [|m| m.process_mb, |m| m.total_mb, |m| m.total_pss_mb];
            line.extend(parts.map(|part| optional(memory.map(part))));
            line
        });
        line.into_iter().collect()
    })
}

/// Writes a CSV file. Every line begins with the scenario and the group.
fn write(
    name: &'static str,
    header: &[&str],
    comparisons: &[Comparison],
    lines: impl Fn(&Comparison, &Group) -> Vec<Vec<String>>,
) -> Result<CsvFile> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["scenario", "group"].iter().chain(header))?;
    for comparison in comparisons {
        for group in &comparison.groups {
            for line in lines(comparison, group) {
                let place = [&comparison.slug, &group.label()].map(|name| csv_name(name));
                writer.write_record(place.iter().chain(&line))?;
            }
        }
    }
    let text = String::from_utf8(writer.into_inner().context("a CSV file in memory")?)?;
    Ok(CsvFile { name, text })
}

fn spread(spread: &Spread) -> [String; 5] {
    let (low, high) = (spread.interval.map(|interval| interval.low), spread.interval.map(|interval| interval.high));
    [spread.runs().to_string(), number(spread.mean), optional(spread.std_error), optional(low), optional(high)]
}

/// Formats a number with four decimals, as in run directories. That is enough for returns and seconds.
fn number(value: f64) -> String {
    format!("{value:.4}")
}

fn optional(value: Option<f64>) -> String {
    value.map_or(String::new(), number)
}
