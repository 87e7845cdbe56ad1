//! The numbers of a report as CSV files.

use anyhow::{Context, Result};

use super::curves::{LossData, learning_curve, loss_curve};
use super::finals::{Final, Runtime, peak_memory};
use super::group::{Comparison, Group};
use dials_core::base::statistics::{Bounds, Spread};
use dials_core::outside::csv_name;

/// Returns the lines of a group in a file, without the scenario and the group.
type Lines = fn(&Comparison, &Group) -> Vec<Vec<String>>;

const FILES: [(&str, &str, Lines); 7] = [
    ("curves.csv", "steps,runs,mean,std_error,low95,high95,median_agent,runtime_s,cpu_s", curves),
    ("aip_cross_entropy.csv", "steps,when,runs,cross_entropy,std_error,low95,high95,marginals", losses),
    (
        "final.csv",
        "steps,finished,runs,episodes,mean,std_error,low95,high95,median_run,median_agent,worst_agent,stuck_agents,agents",
        finals,
    ),
    ("differences.csv", "against,paired_by,seed,difference,low95,high95", differences),
    ("seeds.csv", "seed,steps,episodes,mean,median_agent,runtime_s,cpu_s", seeds),
    ("agents.csv", "seed,steps,agent,mean,median,std_error,stuck", agents),
    (
        "costs.csv",
        "steps,finished,workers,agents_training_s,influence_s,total_s,total_low95_s,total_high95_s,wall_s,cpu_s,\
         cpu_evaluation_s,peak_process_mb,peak_total_mb,peak_total_pss_mb",
        costs,
    ),
];

/// Returns the names and texts of all CSV files. Every line begins with the scenario and the group.
pub(crate) fn files(comparisons: &[Comparison]) -> Result<Vec<(String, String)>> {
    let file = |(name, header, lines): (&str, &str, Lines)| {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(["scenario", "group"].into_iter().chain(header.split(',')))?;
        for comparison in comparisons {
            for group in &comparison.groups {
                let place = [&comparison.slug, &group.label()].map(|name| csv_name(name));
                for line in lines(comparison, group) {
                    writer.write_record(place.iter().chain(&line))?;
                }
            }
        }
        let text = String::from_utf8(writer.into_inner().context("a CSV file in memory")?)?;
        Ok((name.to_owned(), text))
    };
    FILES.into_iter().map(file).collect()
}

fn curves(_: &Comparison, group: &Group) -> Vec<Vec<String>> {
    let points = learning_curve(group).into_iter().map(|point| {
        let [steps, median_agent] = [point.steps.to_string(), number(point.median_agent)];
        [&[steps][..], &spread(&point.returns), &[median_agent, optional(point.runtime_s), optional(point.cpu_s)]]
            .concat()
    });
    points.collect()
}

fn losses(_: &Comparison, group: &Group) -> Vec<Vec<String>> {
    let (data, points) = loss_curve(group);
    let points = points.into_iter().map(|point| {
        let when = match (point.after_training, data) {
            (true, _) => "after training",
            (false, LossData::Fresh) => "evaluation",
            (false, LossData::HeldOut) => "before training",
        };
        let place = [point.steps.to_string(), when.to_owned()];
        [&place[..], &spread(&point.loss), &[number(point.marginals)]].concat()
    });
    points.collect()
}

fn finals(_: &Comparison, group: &Group) -> Vec<Vec<String>> {
    let line = Final::of(group).map(|end| {
        let [runs, figures @ ..] = spread(&end.returns);
        let episodes = end.episodes().map_or(String::new(), |episodes| episodes.count.to_string());
        let agents = [end.median_run, end.median_agent, end.worst_agent.mean_return].map(number);
        let counts = [end.stuck.len(), end.agents].map(|count| count.to_string());
        let place = [end.steps.to_string(), end.finished.to_string(), runs, episodes];
        [&place[..], &figures, &agents, &counts].concat()
    });
    line.into_iter().collect()
}

/// Returns the differences of final returns: one line for all seeds, then one per seed.
fn differences(comparison: &Comparison, group: &Group) -> Vec<Vec<String>> {
    let Some(end) = Final::of(group) else { return Vec::new() };
    let found = comparison.opponents().into_iter().filter_map(|opponent| {
        let found = opponent.difference(group, &end)?;
        let place = [csv_name(opponent.name()), found.pairing.name().to_owned()];
        let [low, high] = interval(found.interval);
        let all = ["all".to_owned(), number(found.mean), low, high];
        let of_seed = |(seed, value): &(u64, f64)| [seed.to_string(), number(*value), String::new(), String::new()];
        let lines = std::iter::once(all).chain(found.of_seeds.iter().map(of_seed));
        Some(lines.map(|line| [&place[..], &line].concat()).collect::<Vec<_>>())
    });
    found.flatten().collect()
}

fn seeds(_: &Comparison, group: &Group) -> Vec<Vec<String>> {
    let lines = group.runs.iter().flat_map(|run| {
        run.evaluations.iter().map(|evaluation| {
            let (steps, episodes) = (evaluation.steps, evaluation.episode_returns.len());
            let place = [run.config.learning.seed.to_string(), steps.to_string(), episodes.to_string()];
            let [mean, median] = [evaluation.all.mean, evaluation.all.median].map(number);
            [&place[..], &[mean, median, optional(run.runtime_at(steps)), optional(run.cpu_at(steps))]].concat()
        })
    });
    lines.collect()
}

fn agents(_: &Comparison, group: &Group) -> Vec<Vec<String>> {
    let Some(end) = Final::of(group) else { return Vec::new() };
    let lines = end.agents_of_runs.iter().flat_map(|(seed, agents)| {
        agents.iter().enumerate().map(|(agent, returns)| {
            let place = [seed.to_string(), end.steps.to_string(), agent.to_string()];
            let figures = [returns.mean, returns.median, returns.std_error].map(number);
            [&place[..], &figures, &[returns.stuck.to_string()]].concat()
        })
    });
    lines.collect()
}

fn costs(_: &Comparison, group: &Group) -> Vec<Vec<String>> {
    let line = Runtime::of(group).map(|time| {
        let memory = peak_memory(group);
        let place = [time.steps.to_string(), time.finished.to_string(), time.workers.to_string()];
        let times = [time.agents_training_s, time.influence_s, time.total.mean].map(number);
        let of_processes = [time.wall_s, time.cpu.total_s, time.cpu.evaluation_s].map(number);
        let memory = [memory.map(|m| m.process_mb), memory.map(|m| m.total_mb), memory.map(|m| m.total_pss_mb)];
        [&place[..], &times, &interval(time.total.interval), &of_processes, &memory.map(optional)].concat()
    });
    line.into_iter().collect()
}

fn spread(spread: &Spread) -> [String; 5] {
    let [low, high] = interval(spread.interval);
    [spread.runs().to_string(), number(spread.mean), optional(spread.std_error), low, high]
}

fn interval(interval: Option<Bounds>) -> [String; 2] {
    [interval.map(|ends| ends.low), interval.map(|ends| ends.high)].map(optional)
}

/// Formats a number with four decimals, as in run directories. That is enough for returns and seconds.
fn number(value: f64) -> String {
    format!("{value:.4}")
}

fn optional(value: Option<f64>) -> String {
    value.map_or(String::new(), number)
}
