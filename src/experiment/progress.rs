//! What of an experiment is done already, as its run directories and measured baselines tell.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};

use super::file::{PlannedBaseline, PlannedRun};
use crate::config;
use crate::report::compare::differing;
use crate::report::find::{Baseline, baseline_file, read_json};
use crate::report::method::Method;
use crate::report::run_dir::{RunRecord, Status, is_run_dir, scenario_of};
use crate::training::files::CONFIG;

/// How far a planned run has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// There is no directory.
    New,
    /// There is one, to be resumed; evaluated up to here.
    Begun {
        steps: u64,
    },
    /// A baseline that was measured otherwise than it is planned now.
    Outdated,
    Finished,
}

impl Stage {
    pub fn name(self) -> &'static str {
        match self {
            Stage::New => "new",
            Stage::Begun { .. } => "to be resumed",
            Stage::Outdated => "outdated",
            Stage::Finished => "finished",
        }
    }

    /// Of its timesteps, from 0 to 1.
    pub fn share(self, run: &PlannedRun) -> f64 {
        match self {
            Stage::New | Stage::Outdated => 0.0,
            Stage::Begun { steps } => steps as f64 / run.config.last_step() as f64,
            Stage::Finished => 1.0,
        }
    }
}

/// The directory of a planned run.
pub fn directory(folder: &Path, run: &PlannedRun) -> PathBuf {
    folder.join(&run.name)
}

/// Looks where a planned run stands; another run at its place is an error.
pub fn stage(folder: &Path, run: &PlannedRun) -> Result<Stage> {
    let dir = directory(folder, run);
    if !is_run_dir(&dir) {
        ensure!(!dir.exists(), "{}: is in the way: it is no run directory", dir.display());
        return Ok(Stage::New);
    }
    if let Some(difference) = difference(&dir, run)? {
        bail!(
            "{}: holds another run than the experiment means ({difference}); move it aside, or name another folder with \
             --out",
            dir.display()
        );
    }
    // What cannot be read was cut short: resuming cuts it back to the checkpoint.
    Ok(match RunRecord::read(&dir).map(|record| record.status()) {
        Ok(Status::Finished) => Stage::Finished,
        Ok(Status::Unfinished { steps }) => Stage::Begun { steps },
        Ok(Status::Empty) | Err(_) => Stage::Begun { steps: 0 },
    })
}

/// Looks whether a controller was measured as planned.
pub fn stage_of_baseline(folder: &Path, planned: &PlannedBaseline) -> Stage {
    let path = baseline_file(folder, &planned.name);
    if !path.exists() {
        return Stage::New;
    }
    let (scenario, controller) = (&planned.scenario, &planned.controller);
    let as_planned = |there: Baseline| {
        (&there.scenario, &there.controller, there.episodes) == (scenario, controller, planned.episodes)
            && there.seed == Some(planned.config.evaluation.seed)
            // Older versions did not write them down.
            && there.episode_returns.len() == planned.episodes
    };
    if read_json(&path).is_ok_and(as_planned) { Stage::Finished } else { Stage::Outdated }
}

/// The first thing in which the run in `dir` differs from the plan, in words.
fn difference(dir: &Path, planned: &PlannedRun) -> Result<Option<String>> {
    let there = config::load_kept(&dir.join(CONFIG))?;
    let scenario = scenario_of(dir, &there, planned.agents())?;
    let planned_keys = Method::of(&planned.config, &planned.scenario).keys;
    let (keys, planned_scenario, planned) = (Method::of(&there, &scenario).keys, &planned.scenario, &planned.config);
    let value = |value: Option<String>| value.unwrap_or("nothing".to_owned());
    Ok(match differing(&keys, &planned_keys).into_iter().next() {
        Some((key, [a, b])) => Some(format!("{key}: {} there, {} planned", value(a), value(b))),
        None if there.last_step() != planned.last_step() => {
            Some(format!("steps: {} there, {} planned", there.last_step(), planned.last_step()))
        }
        None if there.seed != planned.seed => Some(format!("seed: {} there, {} planned", there.seed, planned.seed)),
        None if scenario.id != planned_scenario.id => {
            Some(format!("scenario: {} there, {} planned", scenario.id.word(), planned_scenario.id.word()))
        }
        None => None,
    })
}
