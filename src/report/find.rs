//! What lies under the folders that a report is made of: run directories, measured baselines, and plans of experiments.

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use crate::records::files::is_run_dir;
use crate::records::run_record::RunRecord;

/// What an experiment means to run, in its folder of runs.
pub const PLAN: &str = "plan.json";
/// Where an experiment keeps what `baseline --json` said.
pub const BASELINES: &str = "baselines";
/// Folders below each other that are searched.
const DEPTH: usize = 6;

/// What an experiment means to make.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Plan {
    /// Names of folders beside the plan.
    pub runs: Vec<String>,
    /// Names of files among the baselines, without their ending.
    #[serde(default)]
    pub baselines: Vec<String>,
}

/// Where the plan of a folder puts a baseline.
pub fn baseline_file(folder: &Path, name: &str) -> PathBuf {
    folder.join(BASELINES).join(format!("{name}.json"))
}

/// A hand-coded controller that was measured, as `baseline --json` tells it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Baseline {
    /// [`crate::domain::ScenarioId::word`]
    pub scenario: String,
    pub controller: String,
    pub mean_return: f64,
    pub std_error: f64,
    pub episodes: usize,
    /// Seed of the episodes; `None` in files of older versions.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Mean returns of all agents, episode by episode; empty in files of older versions.
    #[serde(default)]
    pub episode_returns: Vec<f64>,
}

/// A run or a baseline that is not used, and why.
#[derive(Clone, Debug)]
pub struct LeftOut {
    pub dir: PathBuf,
    pub reason: String,
}

/// In one line.
impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reason: Vec<&str> = self.reason.split_whitespace().collect();
        write!(f, "{}: left out: {}", self.dir.display(), reason.join(" "))
    }
}

/// All that was found.
#[derive(Default)]
pub struct Found {
    pub runs: Vec<RunRecord>,
    /// What cannot be read.
    pub unreadable: Vec<LeftOut>,
    /// Runs and baselines of a plan that are not there yet.
    pub missing: Vec<PathBuf>,
    /// Each once, with the file that it is from.
    pub baselines: Vec<(PathBuf, Baseline)>,
}

/// Searches folders; one without any run in it is an error.
pub fn find(folders: &[PathBuf]) -> Result<Found> {
    let mut found = Found::default();
    let mut seen = BTreeMap::new();
    for folder in folders {
        ensure!(folder.is_dir(), "{}: no such folder", folder.display());
        ensure!(
            search(folder, DEPTH, &mut seen, &mut found)?,
            "{}: holds no run directory; `dials-traffic train` and `dials-traffic experiment` make them",
            folder.display()
        );
    }
    Ok(found)
}

/// Whether there is a run, or the plan of one, in a folder. `seen` knows it of the folders that were searched: the same one
/// may be named twice, or lie in another.
fn search(folder: &Path, depth: usize, seen: &mut BTreeMap<PathBuf, bool>, found: &mut Found) -> Result<bool> {
    let failed = || format!("{}: cannot be read", folder.display());
    let place = folder.canonicalize().with_context(failed)?;
    if let Some(&holds) = seen.get(&place) {
        return Ok(holds);
    }
    if is_run_dir(folder) {
        match RunRecord::read(folder) {
            Ok(run) => found.runs.push(run),
            Err(error) => {
                found.unreadable.push(LeftOut { dir: folder.to_owned(), reason: format!("{error:#}") });
            }
        }
        seen.insert(place, true);
        return Ok(true);
    }
    let mut holds = read_plan(folder, found)?;
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).with_context(failed)?.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    entries.sort();
    for entry in entries.iter().filter(|entry| entry.is_dir() && depth > 0 && !is_aside(entry)) {
        if entry.file_name().is_some_and(|name| name == BASELINES) {
            read_baselines(entry, found)?;
        } else {
            holds |= search(entry, depth - 1, seen, found)?;
        }
    }
    seen.insert(place, holds);
    Ok(holds)
}

/// What `--force` moved aside, or what is hidden, counts only where it is named.
fn is_aside(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let aside = name.rsplit_once(".old-").is_some_and(|(_, number)| number.bytes().all(|byte| byte.is_ascii_digit()));
    aside || name.starts_with('.')
}

/// Whether there is one that is not empty.
fn read_plan(folder: &Path, found: &mut Found) -> Result<bool> {
    let path = folder.join(PLAN);
    if !path.is_file() {
        return Ok(false);
    }
    let plan: Plan = read_json(&path)?;
    found.missing.extend(plan.runs.iter().map(|name| folder.join(name)).filter(|run| !is_run_dir(run)));
    let baselines = plan.baselines.iter().map(|name| baseline_file(folder, name));
    found.missing.extend(baselines.filter(|baseline| !baseline.is_file()));
    Ok(!plan.runs.is_empty())
}

fn read_baselines(folder: &Path, found: &mut Found) -> Result<()> {
    let entries = fs::read_dir(folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    paths.sort();
    for path in paths {
        match read_json(&path) {
            // Two experiments on one scenario measure the same.
            Ok(baseline) if found.baselines.iter().any(|(_, other)| *other == baseline) => {}
            Ok(baseline) => found.baselines.push((path, baseline)),
            Err(error) => found.unreadable.push(LeftOut { dir: path, reason: format!("{error:#}") }),
        }
    }
    Ok(())
}

/// Reads a plan or a baseline.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let text = fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: is not what this program writes there", path.display()))
}
