//! Finds the material of a report in its folders: run directories, measured baselines, and plans of experiments.
//!
//! A plan names the runs and baselines that experiments make in a folder, so a report can name what is missing. Several
//! experiments may share a folder. Each has a plan of its own, under the name of its file.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::records::csv_table::LARGEST;
use crate::records::files::is_run_dir;
use crate::records::run_record::RunRecord;
use dials_core::outside::{Directory, FileName, Printable, read_text};

/// Name of the file with the plan, in the folder of runs.
pub const PLAN: &str = "plan.json";
/// Largest plan or baseline. A plan of 100 000 runs has eight mebibytes.
const LARGEST_FILE: u64 = 16 << 20;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExperimentPlan {
    /// Names of the run directories, which are in the same folder as the plan.
    pub runs: Vec<FileName>,
    /// Names of the baseline files, without `.json`.
    pub baselines: Vec<FileName>,
}

/// Contents of `plan.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FolderPlan {
    experiments: BTreeMap<String, ExperimentPlan>,
}

impl FolderPlan {
    /// Reads the plan in a folder. If there is none: `None`.
    pub fn read(folder: &Path) -> Result<Option<FolderPlan>> {
        let path = folder.join(PLAN);
        // A link that leads nowhere is a plan that cannot be read.
        if path.symlink_metadata().is_ok() { read_json(&path).map(Some) } else { Ok(None) }
    }

    /// Puts in the plan of an experiment, in the place of its earlier one. `file`: name of the experiment's file.
    pub fn put(&mut self, file: &str, plan: ExperimentPlan) {
        self.experiments.insert(file.to_owned(), plan);
    }

    /// Lists the names of all planned runs, each once.
    pub(crate) fn runs(&self) -> Vec<&FileName> {
        each_once(self.experiments.values().flat_map(|plan| &plan.runs))
    }

    /// Lists the names of all planned baselines, each once.
    pub(crate) fn baselines(&self) -> Vec<&FileName> {
        each_once(self.experiments.values().flat_map(|plan| &plan.baselines))
    }
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = read_text(path, LARGEST_FILE).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: is not a file of this program", path.display()))
}

fn each_once<'a>(names: impl Iterator<Item = &'a FileName>) -> Vec<&'a FileName> {
    let mut seen: BTreeSet<&str> = BTreeSet::new();
    names.filter(|name| seen.insert(name)).collect()
}

/// Name of the folder in which an experiment keeps the output of `baseline --json`.
pub const BASELINES: &str = "baselines";
/// Number of folder levels that are searched.
pub const DEPTH: usize = 6;

/// Returns the path of a baseline in an experiment's folder of runs.
pub fn baseline_file(folder: &Path, name: &FileName) -> PathBuf {
    folder.join(BASELINES).join(format!("{name}.json"))
}

/// A measured hand-coded controller, as `baseline --json` prints it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct BaselineRecord {
    /// Name of the scenario, from [`dials_core::domain::ScenarioId::word`].
    pub scenario: String,
    pub controller: String,
    pub mean_return: f64,
    pub std_error: f64,
    pub episodes: usize,
    pub seed: u64,
    /// Mean return of all agents in each episode.
    pub episode_returns: Vec<f64>,
    #[serde(flatten)]
    pub(crate) measured_with: MeasuredWith,
}

/// What a controller is measured with, beside the config and its own name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
pub struct MeasuredWith {
    /// CRC-32 of the file that the controller reads; `None` if it reads none.
    pub controller_file_crc32: Option<String>,
    /// Version of SUMO; `None` if the domain does not need it.
    pub sumo_version: Option<String>,
}

impl BaselineRecord {
    /// Returns the version of SUMO on which it was measured; `None` if it needs none.
    pub fn sumo(&self) -> Option<&str> {
        self.measured_with.sumo_version.as_deref()
    }
}

/// A run, a baseline, a plan or a folder that is not used, and why.
#[derive(Clone, Debug)]
pub struct LeftOut {
    pub dir: PathBuf,
    pub reason: String,
}

/// Writes the path and the reason in one printable line.
impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reason: Vec<&str> = self.reason.split_whitespace().collect();
        write!(f, "{}: left out: {}", Printable(self.dir.display()), Printable(reason.join(" ")))
    }
}

#[derive(Default)]
pub struct Found {
    pub runs: Vec<RunRecord>,
    /// Runs, baselines, plans and folders that cannot be read.
    pub unreadable: Vec<LeftOut>,
    /// Runs and baselines of a plan that are not there yet.
    pub missing: Vec<PathBuf>,
    /// Baselines, each once, with its file.
    pub baselines: Vec<(PathBuf, BaselineRecord)>,
}

impl Found {
    /// Returns what was read from `path`. If that failed, it is left out.
    fn unless_left_out<T>(&mut self, path: &Path, read: Result<T>) -> Option<T> {
        let reason = |error: anyhow::Error| LeftOut { dir: path.to_owned(), reason: format!("{error:#}") };
        read.map_err(|error| self.unreadable.push(reason(error))).ok()
    }
}

/// Returns whether a folder holds a run, or the plan of one.
pub fn has_runs(folder: &Path) -> bool {
    search(folder, DEPTH, &mut BTreeMap::new(), &mut Found::default()).unwrap_or(false)
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
/// `seen`: answers for the folders that were searched, because one may be named twice or hold a link back to itself.
fn search(folder: &Path, depth: usize, seen: &mut BTreeMap<PathBuf, bool>, found: &mut Found) -> Result<bool> {
    let failed = || format!("{}: cannot be read", folder.display());
    let place = folder.canonicalize().with_context(failed)?;
    if let Some(&holds) = seen.get(&place) {
        return Ok(holds);
    }
    if is_run_dir(folder) {
        let run = found.unless_left_out(folder, RunRecord::read(folder));
        found.runs.extend(run);
        seen.insert(place, true);
        return Ok(true);
    }
    // Until it has been searched: a link back to it adds nothing.
    seen.insert(place.clone(), false);
    let mut holds = read_plan(folder, found);
    let entries = found.unless_left_out(folder, entries_of(folder)).unwrap_or_default();
    for entry in entries.iter().filter(|entry| entry.is_dir() && depth > 0 && !is_aside(entry)) {
        if entry.file_name().is_some_and(|name| name == BASELINES) {
            read_baselines(entry, found);
        } else {
            let inside = search(entry, depth - 1, seen, found);
            holds |= found.unless_left_out(entry, inside).unwrap_or(false);
        }
    }
    seen.insert(place, holds);
    Ok(holds)
}

/// Returns whether `--force` moved a folder aside, or it is hidden. Such a folder counts only if it is named.
pub fn is_aside(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let aside = name.rsplit_once(".old-").is_some_and(|(_, number)| number.bytes().all(|byte| byte.is_ascii_digit()));
    aside || name.starts_with('.')
}

fn entries_of(folder: &Path) -> Result<Vec<PathBuf>> {
    Ok(Directory::open(folder)?.names()?.iter().map(|name| folder.join(name)).collect())
}

/// Reads the plan in a folder. Returns whether there is one that names a run, or one that cannot be read.
fn read_plan(folder: &Path, found: &mut Found) -> bool {
    let Some(plan) = found.unless_left_out(&folder.join(PLAN), FolderPlan::read(folder)) else { return true };
    let Some(plan) = plan else { return false };
    let runs = plan.runs();
    found.missing.extend(runs.iter().map(|name| folder.join(name)).filter(|run| !is_run_dir(run)));
    let baselines = plan.baselines().into_iter().map(|name| baseline_file(folder, name));
    found.missing.extend(baselines.filter(|baseline| !baseline.is_file()));
    !runs.is_empty()
}

fn read_baselines(folder: &Path, found: &mut Found) {
    let mut paths = found.unless_left_out(folder, entries_of(folder)).unwrap_or_default();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    for path in paths {
        let Some(baseline) = found.unless_left_out(&path, read_baseline(&path)) else { continue };
        // Two experiments on one scenario measure the same baselines, whatever they measure them with.
        let same = |other: &BaselineRecord| {
            *other == BaselineRecord { measured_with: other.measured_with.clone(), ..baseline.clone() }
        };
        if !found.baselines.iter().any(|(_, other)| same(other)) {
            found.baselines.push((path, baseline));
        }
    }
}

/// Reads a baseline. A number in it that is no figure is an error.
pub(crate) fn read_baseline(path: &Path) -> Result<BaselineRecord> {
    let baseline: BaselineRecord = read_json(path)?;
    let means = [("mean_return", baseline.mean_return), ("std_error", baseline.std_error)];
    let figures = means.into_iter().chain(baseline.episode_returns.iter().map(|&value| ("episode_returns", value)));
    for (key, value) in figures {
        if value.is_nan() || value.abs() > LARGEST {
            bail!("{}: `{key}` holds {value:e}, which is too large for a figure; measure it again", path.display());
        }
    }
    Ok(baseline)
}
