//! Progress of an experiment, read from its run directories and measured baselines.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use super::file::{PlannedBaseline, PlannedRun};
use crate::config;
use crate::records::files::{CONFIG, is_run_dir};
use crate::records::reader::scenario_of;
use crate::records::run_record::{RunRecord, Status};
use crate::report::compare::differing;
use crate::report::find::{BaselineRecord, baseline_file, read_baseline};
use crate::report::method::Method;

/// Progress of a planned run or baseline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// There is no directory.
    New,
    /// There is a directory, to be resumed. `steps`: timesteps of the last evaluation.
    Begun {
        steps: u64,
    },
    /// A baseline was measured, but not as planned now.
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

    /// Returns the share of its timesteps that are done, from 0 to 1.
    pub fn share(self, run: &PlannedRun) -> f64 {
        match self {
            Stage::New | Stage::Outdated => 0.0,
            Stage::Begun { steps } => steps as f64 / run.config.last_step() as f64,
            Stage::Finished => 1.0,
        }
    }
}

/// Returns the directory of a planned run.
pub fn directory(folder: &Path, run: &PlannedRun) -> PathBuf {
    folder.join(&run.name)
}

/// Reads the progress of a planned run. A different run in its directory is an error. So is one with files that no
/// killed run leaves behind: only a person can say what became of them.
pub fn stage(folder: &Path, run: &PlannedRun) -> Result<Stage> {
    let dir = directory(folder, run);
    if !is_run_dir(&dir) {
        ensure!(!dir.exists(), "{}: exists, but is not a run directory", dir.display());
        return Ok(Stage::New);
    }
    if let Some(difference) = difference(&dir, run)? {
        bail!(
            "{}: holds a different run than planned ({difference}); move it away, or choose another folder with --out",
            dir.display()
        );
    }
    let record = RunRecord::read(&dir).with_context(|| {
        format!(
            "{}: this run cannot be read; `dials-traffic train --resume` with this directory goes back to a checkpoint \
             that fits its files; or move the directory away, and the run is trained again",
            dir.display()
        )
    })?;
    Ok(match record.status() {
        Status::Finished => Stage::Finished,
        Status::Unfinished { steps } => Stage::Begun { steps },
        Status::Empty => Stage::Begun { steps: 0 },
    })
}

/// Reads whether a controller was measured as planned.
pub fn stage_of_baseline(folder: &Path, planned: &PlannedBaseline) -> Stage {
    let path = baseline_file(folder, &planned.name);
    if !path.exists() {
        return Stage::New;
    }
    let (scenario, controller) = (&planned.scenario, &planned.controller);
    let as_planned = |there: BaselineRecord| {
        (&there.scenario, &there.controller, there.episodes) == (scenario, controller, planned.episodes)
            && there.seed == Some(planned.config.evaluation.seed)
            // Older versions did not write the returns of single episodes.
            && there.episode_returns.len() == planned.episodes
    };
    if read_baseline(&path).is_ok_and(as_planned) { Stage::Finished } else { Stage::Outdated }
}

/// Describes the first difference between the run in `dir` and the plan; `None` if there is none.
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
