//! Every file that a report reads: in run directories, in plans of experiments, and measured baselines.

use std::fs;

use anyhow::{Result, bail};
use dials_core::outside::{Directory, is_printable};
use dials_report::Report;
use dials_session::records::run_json::RunJson;
use dials_session::records::run_record::RunRecord;

use super::place::{Place, copy};
use super::{of_project, read_all};

/// Runs of the report, copied from those of its own tests. The file of a target replaces one of the first.
const RUNS: [&str; 3] = ["traffic_4-dials-seed1", "traffic_4-dials-seed2", "traffic_4-gs-seed1"];
const SAVED: &str = "tests/report/runs";

/// What of a file a report shows.
#[derive(PartialEq)]
enum Shown {
    Numbers,
    Names,
}

/// Names the file of a target, relative to the folder of runs.
macro_rules! files_of_runs {
    ($($call:ident, $seeds:ident, $file:literal, $shown:ident;)*) => {
        $(pub(crate) fn $seeds(_: &Place) -> Vec<Vec<u8>> {
            read_all(&[concat!("tests/report/runs/", $file)])
        }

        pub(crate) fn $call(place: &Place, bytes: &[u8]) -> Result<()> {
            with_file(place, $file, bytes, Shown::$shown)
        })*
    };
}

files_of_runs! {
    returns_csv, returns_csv_seeds, "traffic_4-dials-seed1/returns.csv", Numbers;
    episodes_csv, episodes_csv_seeds, "traffic_4-dials-seed1/episodes.csv", Numbers;
    aip_loss_csv, aip_loss_csv_seeds, "traffic_4-dials-seed1/aip_loss.csv", Numbers;
    timing_csv, timing_csv_seeds, "traffic_4-dials-seed1/timing.csv", Numbers;
    memory_csv, memory_csv_seeds, "traffic_4-dials-seed1/memory.csv", Numbers;
    kept_config, kept_config_seeds, "traffic_4-dials-seed1/config.toml", Names;
    plan_json, plan_json_seeds, "plan.json", Names;
    baseline_json, baseline_json_seeds, "baselines/traffic_4-actuated.json", Names;
}

const DRIFT: &str = "steps,agent,after,loss,marginals
0,all,evaluation,0.69,0.31
0,0,evaluation,0.69,0.31
0,all,training,0.30,0.31
2000000,all,evaluation,0.32,0.312
";

pub(crate) fn aip_drift_csv_seeds(_: &Place) -> Vec<Vec<u8>> {
    vec![DRIFT.into()]
}

pub(crate) fn aip_drift_csv(place: &Place, bytes: &[u8]) -> Result<()> {
    with_file(place, "traffic_4-dials-seed1/aip_drift.csv", bytes, Shown::Numbers)
}

const SCENARIO: &str = r#"{
  "command": ["dials-traffic", "train", "configs/traffic_4.toml"],
  "resumed_with": [{"steps": 2000000, "versions": {"git_commit": "0123456789ab"}}],
  "scenario": {
    "domain": "traffic",
    "agents": 4,
    "episode": {"length": 300, "unit": "steps"},
    "checksum": "0123abcd",
    "files": {"traffic.local_network": "0123abcd"},
    "map": {"rows": 2, "columns": 2, "first_row": "bottom"}
  },
  "seed": 1,
  "versions": {"git_commit": "0123456789ab"},
  "later": 1.5
}
"#;

pub(crate) fn run_json_seeds(_: &Place) -> Vec<Vec<u8>> {
    [read_all(&["tests/report/runs/traffic_4-dials-seed1/run.json"]), vec![SCENARIO.into()]].concat()
}

/// What is accepted comes back equal when it is written and read again, as a resume does.
pub(crate) fn run_json(place: &Place, bytes: &[u8]) -> Result<()> {
    let outcome = with_file(place, "traffic_4-dials-seed1/run.json", bytes, Shown::Names);
    let dir = place.empty("again");
    place.file("again/run.json", bytes);
    if let Ok(read) = RunJson::read(&dir) {
        read.write(&Directory::open(&dir).expect("a directory")).expect("what was read can be written");
        let again = RunJson::read(&dir).expect("it was written by us");
        assert!(again == read, "it is read again as {again:?}");
    }
    outcome
}

/// Makes a report with one file replaced.
fn with_file(place: &Place, file: &str, bytes: &[u8], shown: Shown) -> Result<()> {
    let runs = place.empty("runs");
    RUNS.iter().for_each(|run| copy(&of_project(SAVED).join(run), &runs.join(run)));
    copy(&of_project(SAVED).join("baselines"), &runs.join("baselines"));
    fs::write(runs.join(file), bytes).expect("a file to work with");
    if let Ok(record) = RunRecord::read(&runs.join(RUNS[0])) {
        check_finite(&record);
    }
    let report = dials_report::report(&[runs], None)?;
    check_files(&report, &shown);
    match report.warnings.iter().find(|warning| warning.contains("left out")) {
        Some(warning) => bail!(warning.clone()),
        None => Ok(()),
    }
}

/// Panics if a figure of a run is not a finite number.
fn check_finite(record: &RunRecord) {
    let returns = record.evaluations.iter().flat_map(|evaluation| {
        let all = [evaluation.all.mean, evaluation.all.median, evaluation.all.std_error];
        let agents = evaluation.agents.iter().flat_map(|agent| [agent.mean, agent.median, agent.std_error]);
        all.into_iter().chain(agents).chain(evaluation.episode_returns.iter().copied())
    });
    let losses = record.aip_trainings.iter().flat_map(|training| [training.before, training.after, training.marginals]);
    let fresh = record.fresh_losses.iter().flat_map(|fresh| [fresh.loss, fresh.marginals]);
    let times = record.periods.iter().flat_map(|period| [period.elapsed_s, period.evaluation_s, period.influence_s]);
    let memory = record.memory.iter().flat_map(|memory| [memory.process_mb, memory.total_mb]);
    let bad = returns.chain(losses).chain(fresh).chain(times).chain(memory).find(|figure| !figure.is_finite());
    assert!(bad.is_none(), "a figure of the run is {bad:?}");
}

/// Panics if a file of a report is malformed, holds what acts on a reader, or a figure that is not a finite number.
fn check_files(report: &Report, shown: &Shown) {
    for (name, text) in &report.files {
        let bad = text.chars().find(|&letter| !"\n\t".contains(letter) && !is_printable(letter));
        assert!(bad.is_none(), "{name} holds {bad:?}");
        // In a table, a name is only a name.
        let read = if name.ends_with(".md") { outside_of_fences(text) } else { text.clone() };
        let acts = read.contains("<script>alert") && !name.ends_with(".csv");
        assert!(!acts, "{name} holds a script of somebody else");
        if name.ends_with(".svg") {
            let parsed = roxmltree::Document::parse(text);
            assert!(parsed.is_ok(), "{name} is malformed: {}", parsed.unwrap_err());
        }
        if name.ends_with(".csv") {
            check_cells(name, text);
        }
        // A name may be any word, and a warning on a page may quote one.
        if *shown == Shown::Numbers && !name.starts_with("report.") {
            let mut words = text.split(|letter: char| !letter.is_alphanumeric());
            let bad = words.find(|word| ["nan", "inf", "infinity"].contains(&word.to_ascii_lowercase().as_str()));
            assert!(bad.is_none(), "{name} holds a figure that is {bad:?}");
        }
    }
}

/// Panics if a spreadsheet would compute a cell.
fn check_cells(name: &str, text: &str) {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    for line in reader.records() {
        let line = line.unwrap_or_else(|error| panic!("{name} is malformed: {error}"));
        let bad = line.iter().find(|cell| cell.starts_with(['=', '@', '+']));
        assert!(bad.is_none(), "{name} has a cell that a spreadsheet computes: {bad:?}");
    }
}

/// Returns a Markdown text without its blocks of code, in which nothing acts.
fn outside_of_fences(text: &str) -> String {
    let mut fence: Option<String> = None;
    let mut outside = String::new();
    for line in text.lines() {
        let ticks: String = line.chars().take_while(|&letter| letter == '`').collect();
        match &fence {
            Some(open) if line == open => fence = None,
            Some(_) => {}
            None if ticks.len() >= 3 => fence = Some(ticks),
            None => outside.extend([line, "\n"]),
        }
    }
    outside
}
