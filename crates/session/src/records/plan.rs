//! The plan in a folder of runs: the runs and baselines that experiments make there, so a report can name what is missing.
//!
//! Several experiments may share a folder. Each has a plan of its own, under the name of its file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::Result;
use serde::{Deserialize, Serialize};

use super::json_file::read_json;
use dials_core::outside::FileName;

/// Name of the file with the plan, in the folder of runs.
pub const PLAN: &str = "plan.json";

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

fn each_once<'a>(names: impl Iterator<Item = &'a FileName>) -> Vec<&'a FileName> {
    let mut seen: BTreeSet<&str> = BTreeSet::new();
    names.filter(|name| seen.insert(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(runs: &[&str], baselines: &[&str]) -> ExperimentPlan {
        let [runs, baselines] =
            [runs, baselines].map(|names| names.iter().map(|&name| FileName::new(name).unwrap()).collect());
        ExperimentPlan { runs, baselines }
    }

    fn texts<'a>(names: &[&'a FileName]) -> Vec<&'a str> {
        names.iter().map(|name| &***name).collect()
    }

    #[test]
    fn experiments_in_one_folder_keep_their_plans_and_an_edited_one_replaces_its_own() {
        let mut folder = FolderPlan::default();
        folder.put("a.toml", plan(&["a1", "both"], &["random"]));
        folder.put("b.toml", plan(&["both", "b1"], &["random", "never"]));
        assert_eq!(texts(&folder.runs()), ["a1", "both", "b1"]);
        assert_eq!(texts(&folder.baselines()), ["random", "never"]);
        folder.put("b.toml", plan(&["b2"], &[]));
        assert_eq!(texts(&folder.runs()), ["a1", "both", "b2"]);
        let again: FolderPlan = serde_json::from_str(&serde_json::to_string(&folder).unwrap()).unwrap();
        assert_eq!(again, folder);
    }
}
