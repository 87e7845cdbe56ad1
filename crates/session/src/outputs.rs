//! Checks the output paths of options, and the seconds that pictures show, before any work begins.

use std::fs;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use super::places::{Existing, is_free};
use crate::experiment::LOGS;
use crate::records::files;
use crate::records::find::{BASELINES, PLAN};
use dials_core::outside::folder_of;

/// Checks that `option` may make `path` anew, and that this takes no name from a run.
pub fn check_free(path: &Path, option: &str, existing: Existing) -> Result<()> {
    // First, because --force is no way out of this.
    check_not_of_a_run(option, path)?;
    ensure!(
        existing != Existing::Refuse || is_free(path),
        "{}: exists already; name another place with {option}, or move it aside with --force",
        path.display()
    );
    check_not_a_run(option, path)
}

/// Checks that something can be made at `path`, in the folder above it that exists already. Makes nothing.
pub fn check_can_be_made(path: &Path) -> Result<()> {
    let folder = folder_of(path).ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(folder)
        .map(drop)
        .with_context(|| format!("{}: cannot be made: {} cannot be written to", path.display(), folder.display()))
}

/// Makes the directory if there is none, and checks that a file can be made in it.
pub fn check_writable(dir: &Path) -> Result<()> {
    let failed = || format!("{}: cannot be written to", dir.display());
    fs::create_dir_all(dir).with_context(failed)?;
    tempfile::tempfile_in(dir).map(drop).with_context(failed)
}

/// Checks that `option` would not make a file or directory under a name of a run or an experiment. Others are free.
pub fn check_not_of_a_run(option: &str, path: &Path) -> Result<()> {
    let whole = real(path)?;
    // A link in a run stands in the way of the run, wherever it leads.
    let as_named = match path.file_name() {
        Some(name) => real(folder_of(path))?.join(name),
        None => whole.clone(),
    };
    let places = [whole, as_named];
    for (place, folder) in places.iter().flat_map(|place| place.ancestors().map(move |folder| (place, folder))) {
        let within = place.strip_prefix(folder).expect("it is an ancestor").components().next();
        let Some(name) = within.and_then(|first| first.as_os_str().to_str()) else { continue };
        let owner = match (is_run(folder), folder.join(PLAN).is_file()) {
            (true, _) if files::is_own(name) => "run",
            (_, true) if [PLAN, BASELINES, LOGS].contains(&name) => "experiment",
            _ => continue,
        };
        bail!(
            "{}: {option} must not write here: `{name}` belongs to the {owner} in {}; name a path outside of it",
            path.display(),
            folder.display()
        );
    }
    Ok(())
}

/// Like [`check_not_of_a_run`]. Also checks that `option` would not take the place of a whole run.
pub fn check_not_a_run(option: &str, path: &Path) -> Result<()> {
    ensure!(!is_run(path), "{}: is a run directory; name another directory with {option}", path.display());
    check_not_of_a_run(option, path)
}

/// Returns whether a folder is a run directory. A config alone may be one that its user has written.
fn is_run(folder: &Path) -> bool {
    let written = [files::RUN, files::RETURNS, files::POLICIES, files::CHECKPOINTS];
    files::is_run_dir(folder) && written.iter().any(|name| folder.join(name).exists())
}

/// Checks that the seconds of `--seconds` are in an episode of this length.
pub fn check_seconds(seconds: &Range<usize>, length_s: usize) -> Result<()> {
    ensure!(
        seconds.end <= length_s,
        "--seconds {},{}: an episode has the seconds 0 to {length_s}; end there",
        seconds.start,
        seconds.end
    );
    Ok(())
}

/// Checks that no two options name the same place, and that none lies within another.
pub fn check_apart(places: &[(&str, Option<&Path>)]) -> Result<()> {
    let places = places.iter().filter_map(|&(option, path)| Some((option, path?)));
    let places: Vec<_> = places.map(|(option, path)| Ok((option, path, real(path)?))).collect::<Result<_>>()?;
    for (number, (option, path, place)) in places.iter().enumerate() {
        for (other, _, taken) in &places[..number] {
            ensure!(
                !place.starts_with(taken) && !taken.starts_with(place),
                "{}: {other} and {option} must not write to the same place or into each other; name another path",
                path.display()
            );
        }
    }
    Ok(())
}

/// Resolves the links in a path, as far as it exists. A `..` after that is an error: it may lead anywhere.
fn real(path: &Path) -> Result<PathBuf> {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let known = whole.ancestors().find_map(|known| Some((known.canonicalize().ok()?, whole.strip_prefix(known).ok()?)));
    let (known, rest) = known.unwrap_or((PathBuf::new(), &whole));
    ensure!(
        rest.components().all(|part| part != Component::ParentDir),
        "{}: goes back by `..` from a directory that does not exist; write the path without `..`",
        path.display()
    );
    Ok(known.join(rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn places_that_meet_are_refused_and_others_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().join(name);
        fs::create_dir(place("a")).unwrap();
        symlink(place("a"), place("link")).unwrap();
        let apart = |one: &str, other: &str| check_apart(&[("--x", Some(&place(one))), ("--y", Some(&place(other)))]);
        for (one, other) in [("a", "b"), ("a", "ab"), ("new/a", "new/b"), ("a/b", "link/c")] {
            apart(one, other).unwrap();
        }
        for (one, other) in [("a", "a"), ("new", "./new"), ("new", "new/in"), ("a/b/c", "a"), ("a/b", "link/b")] {
            let error = apart(one, other).unwrap_err().to_string();
            assert!(error.contains(": --x and --y must not write to the same place"), "{error}");
        }
    }

    #[test]
    fn the_names_of_a_run_are_its_own_and_new_names_beside_them_are_free() {
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().join(name);
        fs::create_dir_all(place("run/networks")).unwrap();
        // A user's folder may have a config, too.
        fs::write(place("run/config.toml"), "").unwrap();
        check_not_of_a_run("--out", &place("run/networks")).unwrap();
        fs::write(place("run/run.json"), "").unwrap();
        fs::write(place("plan.json"), "").unwrap();
        symlink(place("run"), place("link")).unwrap();
        symlink(place("elsewhere"), place("run/aips.safetensors")).unwrap();
        let own =
            ["run/networks/deep/in", "run/../run/checkpoints/x", "link/policies.safetensors", "run/worker_12.log"];
        for own in own.into_iter().chain(["run/aips.safetensors", "plan.json", "baselines/x", "logs"]) {
            let error = check_not_of_a_run("--out", &place(own)).unwrap_err().to_string();
            assert!(error.contains(": --out must not write here: `"), "{error}");
        }
        for back in ["new/../run/networks", "run/new/../policies.safetensors"] {
            let error = check_not_of_a_run("--out", &place(back)).unwrap_err().to_string();
            assert!(error.contains(back) && error.ends_with("does not exist; write the path without `..`"), "{error}");
        }
        for free in ["run", "run/policies.pt", "run/pictures/networks", "run/worker_x.log", "run-2", "networks"] {
            check_not_of_a_run("--out", &place(free)).unwrap();
        }
        let error = check_not_a_run("--out", &place("link")).unwrap_err().to_string();
        assert!(error.ends_with("link: is a run directory; name another directory with --out"), "{error}");
    }
}
