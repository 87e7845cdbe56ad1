//! What lies under the folders that a report is made of: run directories, measured baselines, and plans of experiments.

use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::run_dir::{RunRecord, is_run_dir};

/// What an experiment means to run, in its folder of runs.
pub const PLAN: &str = "plan.json";
/// Where an experiment keeps what `baseline --json` said.
pub const BASELINES: &str = "baselines";
/// Folders below each other that are searched.
const DEPTH: usize = 6;

/// The runs that an experiment means to make: names of folders beside the plan.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Plan {
    pub runs: Vec<String>,
}

/// A hand-coded controller that was measured, as `baseline --json` tells it.
#[derive(Clone, Debug, Deserialize)]
pub struct Baseline {
    /// [`super::scenario::Scenario::id`]
    pub scenario: String,
    pub controller: String,
    pub mean_return: f64,
    pub std_error: f64,
    pub episodes: usize,
}

/// A run that is not used, and why.
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
    /// Run directories that cannot be read.
    pub unreadable: Vec<LeftOut>,
    /// Runs of a plan that have no directory yet.
    pub missing: Vec<PathBuf>,
    pub baselines: Vec<Baseline>,
}

/// Searches folders; one without any run in it is an error.
pub fn find(folders: &[PathBuf]) -> Result<Found> {
    let mut found = Found::default();
    let mut seen = BTreeSet::new();
    for folder in folders {
        ensure!(folder.is_dir(), "{}: no such folder", folder.display());
        let before = (found.runs.len() + found.unreadable.len() + found.missing.len(), seen.len());
        search(folder, DEPTH, &mut seen, &mut found)?;
        let after = (found.runs.len() + found.unreadable.len() + found.missing.len(), seen.len());
        ensure!(
            after != before,
            "{}: holds no run directory; `dials-traffic train` and `dials-traffic experiment` make them",
            folder.display()
        );
    }
    Ok(found)
}

fn search(folder: &Path, depth: usize, seen: &mut BTreeSet<PathBuf>, found: &mut Found) -> Result<()> {
    let failed = || format!("{}: cannot be read", folder.display());
    if is_run_dir(folder) {
        // The same run may be named twice.
        if seen.insert(folder.canonicalize().with_context(failed)?) {
            match RunRecord::read(folder) {
                Ok(run) => found.runs.push(run),
                Err(error) => {
                    found.unreadable.push(LeftOut { dir: folder.to_owned(), reason: format!("{error:#}") });
                }
            }
        }
        return Ok(());
    }
    read_plan(folder, found)?;
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).with_context(failed)?.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    entries.sort();
    for entry in entries.iter().filter(|entry| entry.is_dir() && depth > 0 && !is_aside(entry)) {
        if entry.file_name().is_some_and(|name| name == BASELINES) {
            read_baselines(entry, found)?;
        } else {
            search(entry, depth - 1, seen, found)?;
        }
    }
    Ok(())
}

/// What `--force` moved aside, or what is hidden, counts only where it is named.
fn is_aside(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let aside = name.rsplit_once(".old-").is_some_and(|(_, number)| number.bytes().all(|byte| byte.is_ascii_digit()));
    aside || name.starts_with('.')
}

fn read_plan(folder: &Path, found: &mut Found) -> Result<()> {
    let path = folder.join(PLAN);
    if path.is_file() {
        let plan: Plan = read_json(&path)?;
        let missing = plan.runs.iter().map(|name| folder.join(name)).filter(|run| !is_run_dir(run));
        found.missing.extend(missing);
    }
    Ok(())
}

fn read_baselines(folder: &Path, found: &mut Found) -> Result<()> {
    let entries = fs::read_dir(folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    paths.sort();
    for path in paths {
        found.baselines.push(read_json(&path)?);
    }
    Ok(())
}

fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let text = fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: is not what this program writes there", path.display()))
}
