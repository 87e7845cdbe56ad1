//! The tables of costs: runtimes and memory in the paper's layout.

use std::collections::BTreeSet;

use super::document::Table;
use super::family::Family;
use super::finals::{Runtime, peak_memory};
use super::group::{Comparison, Group, method_name};
use super::paper::{self, PaperRuntime};
use super::pictures::comparable;
use super::tables::{NOTHING, words};
use super::words::hours;
use dials_core::domain::ScenarioId;
use dials_session::records::method::Retraining;
use dials_session::records::method::steps_text;
use dials_session::records::run_record::MemoryRecord;

/// Column of a table by number of agents: one of our scenarios, or one that only the paper has.
struct Column<'a> {
    scenario: ScenarioId,
    ours: Option<&'a Comparison>,
}

impl Column<'_> {
    fn name(&self) -> String {
        self.ours.map_or(self.scenario.agents.to_string(), Comparison::size)
    }
}

/// Returns the columns of our scenarios, and of the paper's if one of them is ours, too. They are in order of size.
fn columns<'a>(family: &Family<'a>) -> Vec<Column<'a>> {
    let ours = family.comparisons.iter();
    let ours = ours.map(|&comparison| Column { scenario: comparison.scenario.clone(), ours: Some(comparison) });
    let mut columns: Vec<Column> = ours.collect();
    let domain = &family.comparisons[0].scenario.domain;
    for scenario in paper::scenarios(domain).into_iter().filter(|_| family.has_paper()) {
        if !columns.iter().any(|column| column.scenario.agents == scenario.agents && paper::has(&column.scenario)) {
            columns.push(Column { scenario, ours: None });
        }
    }
    columns.sort_by_key(|column| column.scenario.agents);
    columns
}

pub(crate) fn runtimes(family: &Family) -> Table {
    let columns = columns(family);
    let has_paper = family.has_paper();
    let ours: Vec<Vec<(String, Runtime)>> = columns
        .iter()
        .map(|column| column.ours.iter().flat_map(|comparison| &comparison.groups).filter_map(runtime_row).collect())
        .collect();
    let of_paper = paper::RUNTIMES.iter().filter(|_| has_paper);
    let of_paper: Vec<(String, &str, Retraining)> =
        of_paper.map(|&(simulator, retraining)| (method_name(simulator, retraining), simulator, retraining)).collect();
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
                let paper = paper.as_ref().and_then(of_paper_part).map(|hours| format!("{hours:.2}"));
                beside(time.map(hours), paper, has_paper)
            };
            columns.iter().zip(&ours).map(cell).collect::<Vec<_>>()
        };
        let mut row = vec![label.clone()];
        row.extend(cells(|time| Some(time.agents_training_s), |paper| Some(paper.agents_training)));
        row.extend(cells(|time| (time.influence_s > 0.0).then_some(time.influence_s), |paper| paper.influence));
        row.extend(cells(|time| Some(time.total.mean), |paper| Some(paper.total)));
        let of_cpu = columns.iter().zip(&ours).filter(|(column, _)| column.ours.is_some());
        row.extend(of_cpu.map(|(_, ours)| {
            let time = ours.iter().find(|(own, _)| own == label);
            time.map_or(NOTHING.to_owned(), |(_, time)| hours(time.cpu.runtime_s()))
        }));
        row
    });
    let mut header = words(&[if has_paper { "hours, ours / paper" } else { "hours" }]);
    for part in ["training", "influence", "total"] {
        header.extend(columns.iter().map(|column| format!("{part}, {}", column.name())));
    }
    let of_cpu = columns.iter().filter(|column| column.ours.is_some());
    header.extend(of_cpu.map(|column| format!("CPU hours, {}", column.name())));
    let mut caption = format!(
        "Runtimes for {}: agents training, data collection and influence training, total, by number of agents. Wall \
         time without evaluations, mean over seeds, {}. CPU hours: ours, all processes, without evaluations. \
         Runs that did not train for the paper's 4M steps have rows of their own.",
        family.title,
        machines(&family.comparisons)
    );
    if has_paper {
        caption += &format!(" Paper: {} (128 CPUs, one process per agent).", paper::RUNTIME_SOURCE);
    }
    Table { caption, header, rows: rows.collect() }
}

/// The row is shared with the paper only if the number of steps is comparable.
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

fn machines(comparisons: &[&Comparison]) -> String {
    let groups = comparisons.iter().flat_map(|comparison| &comparison.groups);
    let workers: BTreeSet<usize> = groups.filter_map(|group| Some(Runtime::of(group)?.workers)).collect();
    let workers: Vec<String> = workers.iter().map(usize::to_string).collect();
    let number = if workers.is_empty() { "no".to_owned() } else { workers.join(" or ") };
    format!("with {number} worker {}", if workers == ["1"] { "process" } else { "processes" })
}

/// Writes our figure beside the paper's, if the table has those.
fn beside(ours: Option<String>, paper: Option<String>, has_paper: bool) -> String {
    match (ours, paper) {
        (None, None) => NOTHING.to_owned(),
        (Some(ours), None) if !has_paper => ours,
        (ours, paper) => {
            format!("{} / {}", ours.unwrap_or(NOTHING.to_owned()), paper.unwrap_or(NOTHING.to_owned()))
        }
    }
}

pub(crate) fn memory(family: &Family) -> Table {
    let columns = columns(family);
    let has_paper = family.has_paper();
    let ours = |column: &Column, simulator: &str| -> Option<MemoryRecord> {
        let groups = column.ours.iter().flat_map(|comparison| &comparison.groups);
        let groups = groups.filter(|group| group.simulator() == simulator);
        groups.filter_map(peak_memory).reduce(MemoryRecord::max)
    };
    let megabytes = |value: f64| format!("{value:.1}");
    let total: fn(MemoryRecord) -> f64 = |memory| memory.total_mb;
    let shared: fn(MemoryRecord) -> f64 = |memory| memory.total_pss_mb;
    // Label, simulator, our figure, and the place of the paper's.
    let rows = [
        ("GS, total", "gs", total, Some(0)),
        ("GS, total, shared pages once", "gs", shared, None),
        ("DIALS, per process", "dials", |memory| memory.process_mb, Some(1)),
        ("DIALS, total", "dials", total, Some(2)),
        ("DIALS, total, shared pages once", "dials", shared, None),
    ];
    let rows = rows.map(|(label, simulator, figure, place)| {
        let cell = |column: &Column| {
            let paper = place.and_then(|place: usize| Some(paper::memory(&column.scenario)?[place]));
            beside(ours(column, simulator).map(figure).map(megabytes), paper.map(megabytes), has_paper)
        };
        std::iter::once(label.to_owned()).chain(columns.iter().map(cell)).collect()
    });
    let mut header = words(&[if has_paper { "MiB, ours / MB, paper" } else { "MiB" }]);
    header.extend(columns.iter().map(|column| format!("{} agents", column.name())));
    let mut caption = format!(
        "Peak memory for {}: the largest of all runs of a simulator. Ours: MiB (1 MiB is 1.05 MB), the coordinator with {}.",
        family.title,
        machines(&family.comparisons).trim_start_matches("with "),
    );
    if has_paper {
        caption += &format!(" Paper: MB, DIALS as a process per agent, {}.", paper::MEMORY_SOURCE);
    }
    Table { caption, header, rows: rows.to_vec() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::families;
    use crate::fixtures;
    use crate::group::sort;
    use dials_session::records::find::Found;
    use dials_session::records::run_record::RunRecord;

    #[test]
    fn the_memory_is_the_largest_of_all_runs_in_each_figure() {
        let run = |clip: f64, process_mb, total_mb, pss_mb| {
            let memory = Some(MemoryRecord { process_mb, total_mb, total_pss_mb: pss_mb });
            RunRecord { memory, ..fixtures::run(&format!("ppo.clip = {clip}")) }
        };
        let runs = vec![run(0.1, 10.0, 30.0, 20.0), run(0.2, 12.0, 25.0, 24.0)];
        let comparisons = sort(Found { runs, ..Found::default() }).unwrap().comparisons;
        let table = memory(&families(&comparisons)[0]);
        let ours = |label: &str| {
            let row = table.rows.iter().find(|row| row[0] == label).unwrap();
            row[1].split(" / ").next().unwrap().to_owned()
        };
        let labels = ["DIALS, per process", "DIALS, total", "DIALS, total, shared pages once"];
        assert_eq!(labels.map(ours), ["12.0", "30.0", "24.0"]);
    }
}
