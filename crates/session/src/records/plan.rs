//! The plan in a folder of runs: the runs and baselines that experiments make there, so a report can name what is missing.
//!
//! Several experiments may share a folder. Each has a plan of its own, under the name of its file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use dials_core::outside::{FileName, read_text};

/// Name of the file with the plan, in the folder of runs.
pub const PLAN: &str = "plan.json";
/// Largest plan or baseline. A plan of 100 000 runs has eight mebibytes.
const LARGEST_FILE: u64 = 16 << 20;

/// The plan of one experiment.
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
    /// Plans of the experiments, by the names of their files.
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

/// Reads a plan or a baseline.
pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = read_text(path, LARGEST_FILE).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: is not a file of this program", path.display()))
}

fn each_once<'a>(names: impl Iterator<Item = &'a FileName>) -> Vec<&'a FileName> {
    let mut seen: BTreeSet<&str> = BTreeSet::new();
    names.filter(|name| seen.insert(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn experiments_in_one_folder_keep_their_plans_and_an_edited_one_replaces_its_own() {
        let names = |names: &[&str]| names.iter().map(|&name| FileName::new(name).unwrap()).collect::<Vec<_>>();
        let plan =
            |runs: &[&str], baselines: &[&str]| ExperimentPlan { runs: names(runs), baselines: names(baselines) };
        let mut folder = FolderPlan::default();
        folder.put("a.toml", plan(&["a1", "both"], &["random"]));
        folder.put("b.toml", plan(&["both", "b1"], &["random", "never"]));
        assert_eq!(folder.runs(), names(&["a1", "both", "b1"]).iter().collect::<Vec<_>>());
        assert_eq!(folder.baselines(), names(&["random", "never"]).iter().collect::<Vec<_>>());
        folder.put("b.toml", plan(&["b2"], &[]));
        assert_eq!(folder.runs(), names(&["a1", "both", "b2"]).iter().collect::<Vec<_>>());
    }
}
