//! What the tasks of a benchmark wrote, as the results of its maps.

use std::path::{Path, PathBuf};

use super::Wanted;
use super::prepare::{Prepared, SHARED};
use dials_report::resco::results::{MapResults, Measurement, MethodResults, RunResult};
use dials_session::experiment::file::PlannedRun;
use dials_session::experiment::progress::directory;
use dials_session::records::find::BASELINES;
use dials_session::records::run_record::{RunRecord, Status};

/// Folder of what was measured of last policies, in the folder of the runs.
const EVALUATIONS: &str = "evaluations";
/// Name of the best timings in the tables.
pub(super) const TUNED: &str = "fixed-time, tuned";

/// A file with what `baseline --json` printed, and what it must be about.
pub(super) struct MeasuredFile<'a> {
    /// Name of the task that writes it.
    pub(super) name: String,
    pub(super) path: PathBuf,
    pub(super) scenario: &'a str,
    pub(super) episodes: u32,
}

impl<'a> MeasuredFile<'a> {
    pub(super) fn controller(ready: &'a Prepared, name: &str, wanted: &Wanted<'_>, runs: &Path) -> MeasuredFile<'a> {
        let name = format!("{}-{}", ready.map.name, name.replace(", ", "-"));
        let path = runs.join(BASELINES).join(format!("{name}.json"));
        MeasuredFile { name, path, scenario: &ready.scenario, episodes: wanted.measured_episodes }
    }

    pub(super) fn of_run(
        run: &str,
        greedy: bool,
        ready: &'a Prepared,
        wanted: &Wanted<'_>,
        runs: &Path,
    ) -> MeasuredFile<'a> {
        let name = format!("{run}-{}", if greedy { "greedy" } else { "sampled" });
        let path = runs.join(EVALUATIONS).join(format!("{name}.json"));
        MeasuredFile { name, path, scenario: &ready.scenario, episodes: wanted.measured_episodes }
    }

    fn measurement(&self) -> Option<Measurement> {
        Measurement::of(&self.read()?)
    }
}

/// Reads all results of a map. What is not there is named.
pub(super) fn results(ready: &Prepared, wanted: &Wanted<'_>, runs: &Path) -> MapResults {
    let mut missing = Vec::new();
    let names = ready.controllers.iter().map(|(name, _)| *name).chain([TUNED]);
    let mut controllers = Vec::new();
    for name in names {
        match MeasuredFile::controller(ready, name, wanted, runs).measurement() {
            Some(found) => controllers.push((name.to_owned(), found)),
            None => missing.push(name.to_owned()),
        }
    }
    let mut methods: Vec<MethodResults> = Vec::new();
    for run in ready.experiment.iter().flat_map(|experiment| &experiment.runs) {
        let method = method_of(run);
        let Some(result) = result(run, ready, wanted, runs) else {
            missing.push(run.name.to_string());
            continue;
        };
        match methods.iter_mut().find(|other| other.method == method) {
            Some(other) => other.runs.push(result),
            None => methods.push(MethodResults { method, runs: vec![result] }),
        }
    }
    MapResults { map: ready.map, lights: ready.lights, controllers, methods, missing, notes: ready.notes.clone() }
}

fn method_of(run: &PlannedRun) -> String {
    let learning = &run.config.learning;
    let shared = learning.shares_policies().then_some(SHARED);
    let variant = learning.policy.start.as_deref().or(shared).map_or(String::new(), |variant| format!("-{variant}"));
    format!("{}{variant}", learning.short_form().name)
}

/// Returns the result of a run. `None`: it is not finished, or nothing of its last policies was measured.
fn result(run: &PlannedRun, ready: &Prepared, wanted: &Wanted<'_>, runs: &Path) -> Option<RunResult> {
    let record = RunRecord::read(&directory(runs, run)).ok().filter(|record| record.status() == Status::Finished)?;
    let measured = |greedy: bool| MeasuredFile::of_run(&run.name, greedy, ready, wanted, runs).measurement();
    let [greedy, sampled] = [true, false].map(measured);
    if greedy.is_none() && sampled.is_none() {
        return None;
    }
    let steps = record.evaluations.last().map_or(0, |last| last.steps);
    Some(RunResult {
        seed: run.config.learning.seed,
        greedy,
        sampled,
        cpu_s: record.total_time().map(|time| time.cpu.total_s),
        episodes: steps as f64 / ready.horizon as f64,
    })
}
