//! What of an experiment is done already, as its run directories and measured baselines tell.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::file::{PlannedBaseline, PlannedRun, same_run};
use crate::config::{self, Config};
use crate::records::files::{CONFIG, is_run_dir};
use crate::records::run_record::{RunRecord, Status};
use crate::report::compare::differing;
use crate::report::find::{Baseline, baseline_file, read_json};
use crate::report::scenario::{Method, Scenario};

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
    let there = config::load(&dir.join(CONFIG), &[])?;
    ensure!(
        same_run(&there, &run.config) && Scenario::of(&there, run.agents)? == Scenario::of(&run.config, run.agents)?,
        "{}: holds another run than the experiment means ({}); move it aside, or name another folder with --out",
        dir.display(),
        difference(&there, &run.config)
    );
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

/// The first thing in which a run differs from the plan, in words.
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
