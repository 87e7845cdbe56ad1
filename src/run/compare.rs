//! `compare`: compares two groups of runs.

use std::path::PathBuf;

use anyhow::{Context, ensure};

use crate::cli;
use dials_report::compare::{ComparedSide, compare as compare_sides};
use dials_session::error::{Error, Result};
use dials_session::records::files::is_run_dir;
use dials_session::records::find::is_aside;
use dials_session::terminal::{answer, json};

pub(super) fn compare(args: &cli::CompareArgs) -> Result<()> {
    let side = |name: &str| ComparedSide::open(name, &folders(name)?);
    let (a, b) = (side(&args.a).map_err(Error::Usage)?, side(&args.b).map_err(Error::Usage)?);
    let verdict = compare_sides(&a, &b, args.reach).map_err(Error::Usage)?;
    let found = if args.json { json(verdict.to_json(&a, &b)) } else { verdict.to_text(&a, &b) };
    answer(found).map_err(Error::Run)
}

/// Returns the folders that a side names: a path, a pattern such as `runs/x-seed*`, or several of them, separated by
/// commas.
fn folders(name: &str) -> anyhow::Result<Vec<PathBuf>> {
    let whole = PathBuf::from(name);
    if whole.exists() {
        return Ok(vec![whole]);
    }
    let mut folders = Vec::new();
    for part in name.split(',') {
        let path = PathBuf::from(part);
        if path.exists() {
            folders.push(path);
            continue;
        }
        let matches = glob::glob(part).with_context(|| format!("{part}: is neither a folder nor a valid pattern"))?;
        let before = folders.len();
        // What `--force` moved aside counts only if the pattern names it.
        let counts = |path: &PathBuf| path.is_dir() && (part.contains(".old-") || !is_aside(path));
        let mut matches: Vec<PathBuf> = matches.filter_map(|path| path.ok().filter(counts)).collect();
        // Beside its runs the folder of an experiment has logs and baselines.
        if matches.iter().any(|path| is_run_dir(path)) {
            matches.retain(|path| is_run_dir(path));
        }
        folders.extend(matches);
        let missing = if part.contains(['*', '?', '[']) { "no folder matches this pattern" } else { "no such folder" };
        ensure!(folders.len() > before, "{part}: {missing}{}", hint(name));
    }
    Ok(folders)
}

/// Says how to name several folders, if a side seems to do so in another way.
fn hint(name: &str) -> &'static str {
    if name.contains('{') {
        "; braces are no pattern here: use *, ? and [ab], or name several folders with commas between them"
    } else {
        ""
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_session::records::files::CONFIG;

    /// Makes folders, of which those with a `*` hold a run, and returns the names of what `side` names among them.
    fn named(there: &[&str], side: &str) -> std::result::Result<Vec<String>, String> {
        let dir = tempfile::tempdir().unwrap();
        for name in there {
            let path = dir.path().join(name.trim_end_matches('*'));
            std::fs::create_dir(&path).unwrap();
            if name.ends_with('*') {
                std::fs::write(path.join(CONFIG), "").unwrap();
            }
        }
        let place = dir.path().display();
        let side: Vec<String> = side.split(',').map(|part| format!("{place}/{part}")).collect();
        let found = folders(&side.join(",")).map_err(|error| error.to_string().replace(&format!("{place}/"), ""))?;
        Ok(found.iter().map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect())
    }

    #[test]
    fn a_pattern_names_runs_but_not_what_is_beside_them_or_was_moved_aside() {
        let there = ["a-seed1*", "a-seed2*", "a-seed2.old-1*", "b-seed1*", "logs", "baselines"];
        for (side, expected) in [
            ("a-seed1", &["a-seed1"][..]),
            ("a-*", &["a-seed1", "a-seed2"]),
            ("*", &["a-seed1", "a-seed2", "b-seed1"]),
            ("a-seed1,b-*", &["a-seed1", "b-seed1"]),
            ("a-seed2.old-*", &["a-seed2.old-1"]),
            ("[ab]-seed1", &["a-seed1", "b-seed1"]),
            ("log?", &["logs"]),
        ] {
            assert_eq!(named(&there, side).unwrap(), expected, "{side}");
        }
    }

    #[test]
    fn what_names_nothing_is_told() {
        for (side, message) in [
            ("c", "c: no such folder"),
            ("a-seed1,c", "c: no such folder"),
            ("c-*", "c-*: no folder matches this pattern"),
            (
                "a-seed{1}",
                "a-seed{1}: no such folder; braces are no pattern here: use *, ? and [ab], or name several folders with commas between them",
            ),
            ("a-[", "a-[: is neither a folder nor a valid pattern"),
        ] {
            assert_eq!(named(&["a-seed1*"], side).unwrap_err(), message, "{side}");
        }
    }
}
