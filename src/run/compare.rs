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

/// Returns the folders of a side: a path, a pattern such as `runs/x-seed*`, or several of them with commas between.
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
        let hint = match name.contains('{') {
            true => "; braces are no pattern here: use *, ? and [ab], or name several folders with commas between them",
            false => "",
        };
        ensure!(folders.len() > before, "{part}: {missing}{hint}");
    }
    Ok(folders)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_session::records::files::CONFIG;

    #[test]
    fn a_pattern_names_runs_but_not_what_is_beside_them_or_was_moved_aside() {
        let dir = tempfile::tempdir().unwrap();
        for (name, is_run) in [("a-1", true), ("a-2", true), ("a-2.old-1", true), ("b-1", true), ("logs", false)] {
            std::fs::create_dir(dir.path().join(name)).unwrap();
            if is_run {
                std::fs::write(dir.path().join(name).join(CONFIG), "").unwrap();
            }
        }
        let place = format!("{}/", dir.path().display());
        for (side, expected) in [
            ("*", "a-1 a-2 b-1"),
            ("log?", "logs"),
            ("a-1,c", "c: no such folder"),
            ("a-[", "a-[: is neither a folder nor a valid pattern"),
        ] {
            let side: Vec<String> = side.split(',').map(|part| format!("{place}{part}")).collect();
            let found = folders(&side.join(",")).map_or_else(
                |error| error.to_string(),
                |found| found.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(" "),
            );
            assert_eq!(found.replace(&place, ""), expected);
        }
    }
}
