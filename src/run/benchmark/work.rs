//! The tasks of a benchmark, and their order: hand-coded controllers, the first seed's GS runs, the search for timings, then the other
//! runs seed by seed. So a short budget has the first seed of all maps, and not all seeds of the first one. The last policies of a
//! run are measured as soon as it has ended.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use anyhow::Result;
use serde_json::Value;

use super::Wanted;
use super::gather::{MeasuredFile, TUNED};
use super::prepare::Prepared;
use crate::run::experiment::{PlannedWork, Tasks};
use dials_session::experiment::estimate::Estimate;
use dials_session::experiment::file::PlannedRun;
use dials_session::experiment::progress::Stage;

/// Number of episodes on which the search judges timings. All demands of a map are alike.
const TUNE_EPISODES: &str = "2";
/// Number of episodes of that search, at most.
const SEARCH_EPISODES: usize = 80;

pub(super) struct Plan {
    /// Tasks that are not done.
    pub(super) tasks: Vec<PlannedWork>,
    /// Number of those that were done earlier.
    pub(super) done: usize,
}

impl Plan {
    pub(super) fn of(
        prepared: &[Prepared],
        wanted: &Wanted<'_>,
        runs: &Path,
        cores: usize,
        accept_other_build: bool,
    ) -> Result<Plan> {
        // By their place in the order.
        let mut tasks: Vec<((usize, usize), PlannedWork)> = Vec::new();
        let mut done = 0;
        for ready in prepared {
            for (name, controller) in &ready.controllers {
                let file = MeasuredFile::controller(ready, name, wanted, runs);
                match file.read() {
                    Some(_) => done += 1,
                    None => tasks.push(((0, 0), file.task(of_controller(ready, wanted, controller), 0, ready))),
                }
            }
            let tuned = MeasuredFile::controller(ready, TUNED, wanted, runs);
            match tuned.read() {
                Some(_) => done += 1,
                None => tasks.push(((1, 1), tuned.task(tuning(ready, wanted), SEARCH_EPISODES, ready))),
            }
            let Some(experiment) = &ready.experiment else { continue };
            for task in Tasks::look(experiment, runs, cores, accept_other_build)?.all() {
                let seed = experiment.runs.iter().find(|run| *run.name == *task.name);
                let seed = seed.map_or(0, |run| run.config.learning.seed);
                let place = wanted.seeds.iter().position(|&other| other == seed).unwrap_or(0);
                let is_first = task.name == format!("{}-gs-seed{seed}", ready.map.name);
                let order = (1 + place, if is_first { 0 } else { 2 });
                let missing = measurements(&task, ready, wanted, runs);
                done += 2 - missing.len();
                match task.stage == Stage::Finished {
                    true => {
                        done += 1;
                        tasks.extend(missing.into_iter().map(|task| ((0, 0), task)));
                    }
                    false => tasks.push((order, PlannedWork { then: missing, ..task })),
                }
            }
        }
        tasks.sort_by_key(|(order, _)| *order);
        Ok(Plan { tasks: tasks.into_iter().map(|(_, task)| task).collect(), done })
    }
}

/// Returns the measurements of a run's last policies that are not there. An unfinished run has none that count.
fn measurements(run: &PlannedWork, ready: &Prepared, wanted: &Wanted<'_>, runs: &Path) -> Vec<PlannedWork> {
    let dir = runs.join(&run.name);
    // Such policies see something else than the config of the map says.
    let is_it = |planned: &&PlannedRun| *planned.name == run.name;
    let planned = ready.experiment.iter().flat_map(|experiment| &experiment.runs).find(is_it);
    let has_start = planned.is_some_and(|planned| planned.config.learning.policy.start.is_some());
    let of = |greedy: bool| {
        let file = MeasuredFile::of_run(&run.name, greedy, ready, wanted, runs);
        let there = if run.stage == Stage::Finished { file.read() } else { None };
        let mut arguments: Vec<OsString> = vec!["baseline".into(), ready.measured_on.clone().into()];
        arguments.extend(["--compare".into(), dir.clone().into()]);
        arguments.extend(greedy.then(|| "--greedy".into()));
        if has_start {
            arguments.extend(["--set", "traffic.observation=lanes"].map(OsString::from));
        }
        arguments.extend(episodes(wanted));
        match there {
            Some(_) => None,
            None => Some(file.task(arguments, 0, ready)),
        }
    };
    [true, false].into_iter().filter_map(of).collect()
}

fn of_controller(ready: &Prepared, wanted: &Wanted<'_>, controller: &str) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = vec!["baseline".into(), ready.measured_on.clone().into()];
    arguments.extend(["--controller", controller].map(OsString::from));
    arguments.extend(episodes(wanted));
    arguments
}

fn tuning(ready: &Prepared, wanted: &Wanted<'_>) -> Vec<OsString> {
    let mut arguments = of_controller(ready, wanted, "fixed-time");
    arguments.extend(["--tune", "--tune-episodes", TUNE_EPISODES].map(OsString::from));
    arguments
}

fn episodes(wanted: &Wanted<'_>) -> [OsString; 4] {
    ["--json".into(), "--without-lights".into(), "--episodes".into(), wanted.measured_episodes.to_string().into()]
}

impl MeasuredFile<'_> {
    /// Makes the task that writes the file. `before`: number of episodes that it plays before it measures.
    fn task(&self, arguments: Vec<OsString>, before: usize, ready: &Prepared) -> PlannedWork {
        let steps = ready.lights * ready.horizon * (before + self.episodes as usize);
        let estimate = Estimate {
            seconds: 2.0 + steps as f64 * ready.rough_costs.evaluation_s,
            memory_mb: ready.rough_costs.process_mb,
            measured_runs: 0,
        };
        PlannedWork::measurement(self.name.clone(), arguments, self.path.clone(), estimate)
    }

    /// Returns what was measured, if it was measured as it would be now: on this scenario, with this number of episodes.
    pub(super) fn read(&self) -> Option<Value> {
        let printed: Value = serde_json::from_slice(&fs::read(&self.path).ok()?).ok()?;
        let player = match printed.get("controllers") {
            Some(players) => players.get(0)?.clone(),
            None => printed.clone(),
        };
        let is_of = printed.get("scenario").and_then(Value::as_str) == Some(self.scenario);
        let is_long = player.get("episodes").and_then(Value::as_u64) == Some(self.episodes.into());
        (is_of && is_long).then_some(player)
    }
}
