//! Makes directories whole or not at all, and checks that the output paths of options do not overlap.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::outside::{Busy, Directory, StagedDirectory, rename_to_free};
use crate::records::atomic::folder_of;
use crate::terminal::tell;

/// Number of levels of folders that are searched for runs that are being written.
const LEVELS: usize = 6;

/// What to do if the path of a new directory exists already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Report an error.
    Refuse,
    /// Move it to the first free of `path.old-1`, `path.old-2`, ...
    MoveAside,
    /// Leave it and take the first free of `path-2`, `path-3`, ...
    Number,
}

/// Returns the path at which [`make`] will make a directory. With `Existing::Refuse` an existing path is an error.
pub fn place(path: &Path, existing: Existing) -> Result<PathBuf> {
    // `..` and `/` have no name that a number could be added to.
    ensure!(path.file_name().is_some(), "{}: has no name of its own; name a new directory", path.display());
    let path = match existing {
        Existing::Refuse | Existing::MoveAside => path.to_owned(),
        Existing::Number => first_free(path, "-", 2),
    };
    ensure!(
        existing != Existing::Refuse || is_free(&path),
        "{}: exists already; name another one with --out, or move it aside with --force",
        path.display()
    );
    Ok(path)
}

/// Makes a directory at `path`, or beside it if `existing` says so, and returns it, locked. `fill` writes its content
/// into the directory that it is given.
///
/// The new directory is filled under a temporary name beside `path` and then renamed. So an error leaves everything as
/// it was. And the old directory, which is moved aside last, may be the source of the content.
pub fn make(path: &Path, existing: Existing, fill: impl FnOnce(&Path) -> Result<()>) -> Result<Directory> {
    let parent = folder_of(path);
    let new_folders: Vec<&Path> = parent.ancestors().take_while(|folder| !folder.exists()).collect();
    fill_and_move(path, parent, existing, fill).inspect_err(|_| {
        new_folders.iter().for_each(|folder| drop(fs::remove_dir(folder)));
    })
}

fn fill_and_move(
    path: &Path,
    parent: &Path,
    existing: Existing,
    fill: impl FnOnce(&Path) -> Result<()>,
) -> Result<Directory> {
    let failed = || format!("{}: cannot be made", path.display());
    if !parent.exists() {
        fs::create_dir_all(parent).with_context(failed)?;
    }
    let mut staged = StagedDirectory::make_in(parent).with_context(failed)?;
    fill(staged.path())?;
    // Another process may take the same place at any moment, so nothing is decided before the directory is there.
    loop {
        let place = place(path, existing)?;
        let aside = match existing {
            Existing::MoveAside if !is_free(&place) => Some(move_aside(&place)?),
            _ => None,
        };
        let moved = staged.move_to(&place);
        match (&moved, &aside) {
            (Err(_), Some(aside)) => drop(fs::rename(aside, &place)),
            (Ok(_), Some(aside)) => tell_moved(&place, aside),
            (_, None) => {}
        }
        if let Some(made) = moved? {
            return Ok(made);
        }
    }
}

/// Renames `path` to the first free of `path.old-1`, `path.old-2`, ... and returns the new path. If another process
/// writes there, this is an error.
pub fn move_aside(path: &Path) -> Result<PathBuf> {
    let failed = || format!("{}: cannot be moved aside", path.display());
    let _held = if path.is_dir() { Some(hold(path)?) } else { None };
    let (parent, name) = (Directory::open(folder_of(path))?, path.file_name().with_context(failed)?);
    loop {
        let aside = first_free(path, ".old-", 1);
        let aside_name = aside.file_name().expect("it is a name with a number");
        if rename_to_free(&parent, name, aside_name).with_context(failed)? {
            return Ok(aside);
        }
    }
}

/// Locks a directory that is to be moved, and checks that nobody writes a run within it.
fn hold(path: &Path) -> Result<Directory> {
    let held = Directory::lock(path)?;
    locked_within(path, LEVELS).map_or(Ok(held), |busy| Err(Busy(busy).into()))
}

/// Finds a directory within `path` that another process writes. Follows no link.
fn locked_within(path: &Path, levels: usize) -> Option<PathBuf> {
    let entries = fs::read_dir(path).ok()?.flatten();
    let folders = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
    folders.map(|entry| entry.path()).find_map(|folder| match Directory::is_locked(&folder) {
        true => Some(folder),
        false if levels > 1 => locked_within(&folder, levels - 1),
        false => None,
    })
}

pub fn tell_moved(path: &Path, aside: &Path) {
    tell(format_args!("moved {} to {}", path.display(), aside.display()));
}

/// Returns `path` itself if it is free and numbers begin at 2, otherwise the first free of `path` + `word` + number.
fn first_free(path: &Path, word: &str, first: usize) -> PathBuf {
    if first > 1 && is_free(path) {
        return path.to_owned();
    }
    let mut candidates = (first..).map(|number| {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!("{word}{number}"));
        path.with_file_name(name)
    });
    candidates.find(|candidate| is_free(candidate)).expect("numbers go on")
}

/// Checks that nothing is at `path`, where `option` will make a directory.
pub fn check_free(path: &Path, option: &str) -> Result<()> {
    ensure!(is_free(path), "{}: exists already; name another directory with {option}", path.display());
    Ok(())
}

/// Makes the directory if there is none, and checks that a file can be made in it.
pub fn check_writable(dir: &Path) -> Result<()> {
    let failed = || format!("{}: cannot be written to", dir.display());
    fs::create_dir_all(dir).with_context(failed)?;
    tempfile::tempfile_in(dir).map(drop).with_context(failed)
}

/// Checks that no two options name the same place, and that none lies within another.
pub fn check_apart(places: &[(&str, Option<&Path>)]) -> Result<()> {
    let places: Vec<_> = places.iter().filter_map(|&(option, path)| Some((option, path?, real(path?)))).collect();
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

/// Resolves the links in a path, as far as it exists.
fn real(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let known = path.ancestors().find_map(|known| Some((known.canonicalize().ok()?, path.strip_prefix(known).ok()?)));
    known.map(|(known, rest)| known.join(rest)).unwrap_or(path)
}

/// Returns whether nothing is at `path`, not even a broken link.
pub fn is_free(path: &Path) -> bool {
    path.symlink_metadata().is_err()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_place_that_is_taken_while_the_directory_is_filled_is_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run");
        let others = || -> Result<()> {
            fs::create_dir(&path)?;
            Ok(fs::write(path.join("theirs"), "x")?)
        };
        let made = make(&path, Existing::Number, |_| others()).unwrap();
        assert_eq!(made.path(), dir.path().join("run-2"));
        fs::remove_dir_all(&path).unwrap();
        let error = make(&path, Existing::Refuse, |_| others()).unwrap_err().to_string();
        assert!(error.contains("run: exists already"), "{error}");
        fs::remove_dir_all(&path).unwrap();
        make(&path, Existing::MoveAside, |_| others()).unwrap();
        assert_eq!(names(dir.path()), ["run", "run-2", "run.old-1"]);
        assert!(path.with_file_name("run.old-1").join("theirs").exists());
    }

    #[test]
    fn what_another_process_writes_is_not_moved() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("all");
        fs::create_dir_all(path.join("deep/run")).unwrap();
        for busy in [path.clone(), path.join("deep/run")] {
            let lock = Directory::lock(&busy).unwrap();
            let error = format!("{:#}", move_aside(&path).unwrap_err());
            assert!(error.contains(&format!("{}: another process", busy.display())), "{error}");
            assert_eq!(names(dir.path()), ["all"]);
            drop(lock);
        }
        move_aside(&path).unwrap();
        assert_eq!(names(dir.path()), ["all.old-1"]);
    }

    #[test]
    fn places_that_meet_are_told_from_places_apart() {
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().join(name);
        fs::create_dir(place("a")).unwrap();
        std::os::unix::fs::symlink(place("a"), place("link")).unwrap();
        let apart = |one: &str, other: &str| check_apart(&[("--x", Some(&place(one))), ("--y", Some(&place(other)))]);
        for (one, other) in [("a", "b"), ("a", "ab"), ("new/a", "new/b"), ("a/b", "link/c")] {
            apart(one, other).unwrap();
        }
        for (one, other) in [("a", "a"), ("new", "./new"), ("new", "new/in"), ("a/b/c", "a"), ("a/b", "link/b")] {
            let error = apart(one, other).unwrap_err().to_string();
            assert!(error.contains(": --x and --y must not write to the same place"), "{error}");
        }
        check_apart(&[("--x", None), ("--y", Some(&place("a"))), ("--z", None)]).unwrap();
    }

    #[test]
    fn a_new_directory_has_a_name() {
        for nameless in ["..", "/", "a/..", ""] {
            for existing in [Existing::Refuse, Existing::MoveAside, Existing::Number] {
                let error = place(Path::new(nameless), existing).unwrap_err().to_string();
                assert!(error.ends_with("has no name of its own; name a new directory"), "{error}");
            }
        }
    }
}
