//! Paths of route files in a config. The name of a file may have `*` and `?`, so that a line names a thousand files.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use glob::{MatchOptions, Pattern};

use dials_core::outside::folder_of;

/// Largest number of files of which an episode plays one.
const MOST_FILES: usize = 10_000;

/// `*` does not match the dot of a hidden file, as in a shell.
const AS_IN_A_SHELL: MatchOptions =
    MatchOptions { case_sensitive: true, require_literal_separator: true, require_literal_leading_dot: true };

/// Returns the files that a path means: the one of this name, or else all that fit it, in the order of their names.
///
/// An error says why there is none.
pub fn files_called(path: &Path) -> Result<Vec<PathBuf>> {
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let shown = path.display();
    let folder = folder_of(path);
    ensure!(
        folder.is_dir(),
        "{shown}: there is no folder {}; `*` may stand in the name of a file only",
        folder.display()
    );
    let name = path.file_name().and_then(|name| name.to_str());
    let name = name.with_context(|| format!("{shown}: names no file; correct the path"))?;
    let pattern = Pattern::new(name).with_context(|| format!("{shown}: is neither a file nor a valid pattern"))?;
    let entries = fs::read_dir(folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let fits = |name: &String| pattern.matches_with(name, AS_IN_A_SHELL);
    let names: BTreeSet<String> = names.filter(fits).collect();
    let files = names.into_iter().map(|name| path.with_file_name(name)).filter(|file| file.is_file());
    let files: Vec<PathBuf> = files.collect();
    ensure!(!files.is_empty(), "{shown}: there is no such file; correct the path");
    Ok(files)
}

/// Returns the files of each path. An error names a path without files, and a file that is named twice.
pub(super) fn all(paths: &[PathBuf]) -> Result<Vec<Vec<PathBuf>>> {
    let files = paths.iter().map(|path| files_called(path)).collect::<Result<Vec<_>>>()?;
    let mut known = BTreeSet::new();
    for file in files.iter().flatten() {
        ensure!(
            known.insert(file),
            "{}: is named twice, so it would be drawn more often; name it once",
            file.display()
        );
    }
    ensure!(known.len() <= MOST_FILES, "{} files are named, and at most {MOST_FILES} are allowed", known.len());
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| fs::write(dir.path().join(name), "<routes/>").unwrap());
        dir
    }

    #[test]
    fn a_pattern_means_all_files_that_fit_it_in_the_order_of_their_names() {
        let dir =
            folder(&["a_2.rou.xml", "a_1.rou.xml", "a_10.rou.xml", ".a_3.rou.xml", "b_1.rou.xml", "a_[x].rou.xml"]);
        let names = |pattern: &str| -> Vec<String> {
            let files = files_called(&dir.path().join(pattern)).unwrap();
            files.iter().map(|file| file.file_name().unwrap().to_string_lossy().into_owned()).collect()
        };
        assert_eq!(names("a_[0-9]*.rou.xml"), ["a_1.rou.xml", "a_10.rou.xml", "a_2.rou.xml"]);
        assert_eq!(names("?_1.rou.xml"), ["a_1.rou.xml", "b_1.rou.xml"]);
        assert_eq!(names("a_[x].rou.xml"), ["a_[x].rou.xml"], "a file of this very name comes first");
        assert!(files_called(&dir.path().join("*_3.rou.xml")).is_err(), "it is hidden");
    }

    #[test]
    fn paths_without_a_file_and_files_that_are_named_twice_are_errors() {
        let dir = folder(&["a_1.rou.xml", "a_2.rou.xml"]);
        let error = |patterns: &[&str]| {
            let paths: Vec<PathBuf> = patterns.iter().map(|pattern| dir.path().join(pattern)).collect();
            all(&paths).unwrap_err().to_string().replace(&format!("{}/", dir.path().display()), "DIR/")
        };
        assert_eq!(error(&["b_*.rou.xml"]), "DIR/b_*.rou.xml: there is no such file; correct the path");
        assert!(error(&["d*/a_1.rou.xml"]).starts_with("DIR/d*/a_1.rou.xml: there is no folder DIR/d*; `*` may stand"));
        assert!(error(&["a_*.rou.xml", "a_2.rou.xml"]).starts_with("DIR/a_2.rou.xml: is named twice"));
    }
}
