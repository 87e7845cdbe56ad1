//! Finds the material of a report in its folders: run directories, measured baselines, and plans of experiments.

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use crate::records::files::is_run_dir;
use crate::records::run_record::RunRecord;

/// Name of the file with the plan of an experiment, in its folder of runs.
pub const PLAN: &str = "plan.json";
/// Name of the folder in which an experiment keeps the output of `baseline --json`.
pub const BASELINES: &str = "baselines";
/// Number of folder levels that are searched.
const DEPTH: usize = 6;

/// The plan of an experiment.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ExperimentPlan {
    /// Names of the run directories, which are in the same folder as the plan.
    pub runs: Vec<String>,
    /// Names of the baseline files, without `.json`.
    #[serde(default)]
    pub baselines: Vec<String>,
}

/// Returns the path of a baseline in an experiment's folder of runs.
pub fn baseline_file(folder: &Path, name: &str) -> PathBuf {
    folder.join(BASELINES).join(format!("{name}.json"))
}

/// A measured hand-coded controller, as `baseline --json` prints it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct BaselineRecord {
    /// Name of the scenario, from [`crate::domain::ScenarioId::word`].
    pub scenario: String,
    pub controller: String,
    pub mean_return: f64,
    pub std_error: f64,
    pub episodes: usize,
    /// Seed of the episodes; `None` in files of older versions.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Mean return of all agents in each episode; empty in files of older versions.
    #[serde(default)]
    pub episode_returns: Vec<f64>,
}

/// A run or a baseline that is not used, and why.
#[derive(Clone, Debug)]
pub struct LeftOut {
    pub dir: PathBuf,
    pub reason: String,
}

/// Writes the path and the reason in one line.
impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reason: Vec<&str> = self.reason.split_whitespace().collect();
        write!(f, "{}: left out: {}", self.dir.display(), reason.join(" "))
    }
}

/// Everything that was found.
#[derive(Default)]
pub struct Found {
    pub runs: Vec<RunRecord>,
    /// Runs and baselines that cannot be read.
    pub unreadable: Vec<LeftOut>,
    /// Runs and baselines of a plan that are not there yet.
    pub missing: Vec<PathBuf>,
    /// Baselines, each once, with its file.
    pub baselines: Vec<(PathBuf, BaselineRecord)>,
}

/// Searches folders. A folder without any run in it is an error.
pub fn find(folders: &[PathBuf]) -> Result<Found> {
    let mut found = Found::default();
    let mut seen = BTreeMap::new();
    for folder in folders {
        ensure!(folder.is_dir(), "{}: no such folder", folder.display());
        ensure!(
            search(folder, DEPTH, &mut seen, &mut found)?,
            "{}: holds no run directory; make one with `dials-traffic train` or `dials-traffic experiment`",
            folder.display()
        );
    }
    Ok(found)
}

/// Searches a folder. Returns whether it holds a run, or the plan of one.
///
/// `seen`: the answers for the folders that were searched already. The same folder may be named twice, or be inside
/// another.
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

/// Returns whether `--force` moved a folder aside, or it is hidden. Such a folder counts only if it is named.
fn is_aside(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let aside = name.rsplit_once(".old-").is_some_and(|(_, number)| number.bytes().all(|byte| byte.is_ascii_digit()));
    aside || name.starts_with('.')
}

/// Reads the plan in a folder. Returns whether there is one that names a run.
fn read_plan(folder: &Path, found: &mut Found) -> Result<bool> {
    let path = folder.join(PLAN);
    if !path.is_file() {
        return Ok(false);
    }
    let plan: ExperimentPlan = read_json(&path)?;
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
            // Two experiments on one scenario measure the same baselines.
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
    serde_json::from_str(&text).with_context(|| format!("{}: is not a file of this program", path.display()))
}
