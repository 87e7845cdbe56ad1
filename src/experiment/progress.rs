//! What of an experiment is done already, as its run directories tell.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::file::{PlannedRun, same_run};
use crate::report::run_dir::{RunRecord, Status, is_run_dir};
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
    Finished,
}

impl Stage {
    pub fn name(self) -> &'static str {
        match self {
            Stage::New => "new",
            Stage::Begun { .. } => "to be resumed",
            Stage::Finished => "finished",
        }
    }

    /// Of its timesteps, from 0 to 1.
    pub fn share(self, run: &PlannedRun) -> f64 {
        match self {
            Stage::New => 0.0,
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
    let record = RunRecord::read(&dir)?;
    ensure!(
        same_run(&record.config, &run.config)
            && Scenario::of(&record.config, run.agents)? == Scenario::of(&run.config, run.agents)?,
        "{}: holds another run than the experiment means ({}); move it aside, or name another folder with --out",
        dir.display(),
        difference(&record, run)
    );
    Ok(match record.status() {
        Status::Finished => Stage::Finished,
        Status::Unfinished { steps } => Stage::Begun { steps },
        Status::Empty => Stage::Begun { steps: 0 },
    })
}

/// The first thing in which a run differs from the plan, in words.
fn difference(record: &RunRecord, run: &PlannedRun) -> String {
    let (there, planned) = (Method::of(&record.config).keys, Method::of(&run.config).keys);
    let mut keys = there.keys().chain(planned.keys());
    let key = keys.find(|key| there.get(*key) != planned.get(*key));
    let value = |value: Option<&String>| value.map_or("nothing".to_owned(), String::clone);
    match key {
        Some(key) => format!("{key}: {} there, {} planned", value(there.get(key)), value(planned.get(key))),
        None if record.config.last_step() != run.config.last_step() => {
            format!("steps: {} there, {} planned", record.config.last_step(), run.config.last_step())
        }
        None if record.config.seed != run.config.seed => {
            format!("seed: {} there, {} planned", record.config.seed, run.config.seed)
        }
        None => "another network".to_owned(),
    }
}
