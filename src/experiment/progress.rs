//! Progress of an experiment, read from its run directories and measured baselines.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::file::{PlannedBaseline, PlannedRun, same_run};
use crate::config::{self, Config};
use crate::report::compare::differing;
use crate::report::find::{Baseline, baseline_file, read_json};
use crate::report::run_dir::{RunRecord, Status, is_run_dir};
use crate::report::scenario::{Method, Scenario};
use crate::training::files::CONFIG;

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

/// Reads the progress of a planned run. A different run in its directory is an error.
pub fn stage(folder: &Path, run: &PlannedRun) -> Result<Stage> {
    let dir = directory(folder, run);
    if !is_run_dir(&dir) {
        ensure!(!dir.exists(), "{}: exists, but is not a run directory", dir.display());
        return Ok(Stage::New);
    }
    let there = config::load(&dir.join(CONFIG), &[])?;
    ensure!(
        same_run(&there, &run.config) && Scenario::of(&there, run.agents)? == Scenario::of(&run.config, run.agents)?,
        "{}: holds a different run than planned ({}); move it away, or choose another folder with --out",
        dir.display(),
        difference(&there, &run.config)
    );
    // Files that cannot be read were cut short. Resuming cuts them back to the checkpoint.
    Ok(match RunRecord::read(&dir).map(|record| record.status()) {
        Ok(Status::Finished) => Stage::Finished,
        Ok(Status::Unfinished { steps }) => Stage::Begun { steps },
        Ok(Status::Empty) | Err(_) => Stage::Begun { steps: 0 },
    })
}

/// Reads whether a controller was measured as planned.
pub fn stage_of_baseline(folder: &Path, planned: &PlannedBaseline) -> Stage {
    let path = baseline_file(folder, &planned.name);
    if !path.exists() {
        return Stage::New;
    }
    let (scenario, controller) = (&planned.scenario, &planned.controller);
    let as_planned = |there: Baseline| {
        (&there.scenario, &there.controller, there.episodes) == (scenario, controller, planned.episodes)
            && there.seed == Some(planned.config.evaluation.seed)
            // Older versions did not write the returns of single episodes.
            && there.episode_returns.len() == planned.episodes
    };
    if read_json(&path).is_ok_and(as_planned) { Stage::Finished } else { Stage::Outdated }
}

/// Describes the first difference between a run and the plan.
fn difference(there: &Config, planned: &Config) -> String {
    let [a, b] = [there, planned].map(|config| Method::of(config).keys);
    let value = |value: Option<String>| value.unwrap_or("nothing".to_owned());
    match differing(&a, &b).into_iter().next() {
        Some((key, [a, b])) => format!("{key}: {} there, {} planned", value(a), value(b)),
        None if there.last_step() != planned.last_step() => {
            format!("steps: {} there, {} planned", there.last_step(), planned.last_step())
        }
        None if there.seed != planned.seed => format!("seed: {} there, {} planned", there.seed, planned.seed),
        None => "another network".to_owned(),
    }
}
