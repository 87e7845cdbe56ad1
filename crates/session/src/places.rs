//! Makes directories whole or not at all, and moves aside what stands in their place.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::terminal::note;
use dials_core::outside::{Busy, Directory, StagedDirectory, folder_of, rename_to_free};

/// Number of levels of folders that are searched for runs that are being written.
const LEVELS: usize = 6;

/// What to do if the path of a new directory exists already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    Refuse,
    /// Move it to the first free of `path.old-1`, `path.old-2`, ...
    MoveAside,
    /// Leave it and take the first free of `path-2`, `path-3`, ...
    Number,
}

impl Existing {
    /// Returns the rule for a path that the user has named. `force`: whether `--force` was given.
    pub fn of_named(force: bool) -> Existing {
        if force { Existing::MoveAside } else { Existing::Refuse }
    }
}

/// Returns the path at which [`make`] will make a directory. With `Existing::Refuse` an existing path is an error.
pub fn place(path: &Path, existing: Existing) -> Result<PathBuf> {
    // `..` and `/` have no name that a number could be added to.
    ensure!(path.file_name().is_some(), "{}: has no name of its own; name a new directory", path.display());
    match existing {
        Existing::Number if !is_free(path) => return Ok(first_free(path, "-", 2)),
        Existing::Refuse => ensure!(
            is_free(path),
            "{}: exists already; name another one with --out, or move it aside with --force",
            path.display()
        ),
        _ => (),
    }
    Ok(path.to_owned())
}

/// Makes a directory at `path`, or beside it if `existing` says so, and returns it, locked. `fill` writes its content
/// into the directory that it is given. All of it is on the disk before the directory gets its name.
///
/// The new directory is filled under a temporary name beside `path` and then renamed. So an error leaves everything as
/// it was. And the old directory, which is moved aside last, may be the source of the content.
pub fn make(path: &Path, existing: Existing, fill: impl FnOnce(&Directory) -> Result<()>) -> Result<Directory> {
    let parent = folder_of(path);
    let new_folders: Vec<&Path> = parent.ancestors().take_while(|folder| !folder.exists()).collect();
    let made = || -> Result<Directory> {
        let failed = || format!("{}: cannot be made", path.display());
        if !parent.exists() {
            fs::create_dir_all(parent).with_context(failed)?;
        }
        let mut staged = StagedDirectory::make_in(parent)
            .with_context(|| format!("{}: cannot be written to", parent.display()))
            .with_context(failed)?;
        fill(staged.directory())?;
        staged.directory().sync_tree()?;
        // Another process may take the same place at any moment, so nothing is decided before the directory is there.
        loop {
            let place = place(path, existing)?;
            clear(&place, existing)?;
            if let Some(made) = staged.move_to(&place)? {
                return Ok(made);
            }
        }
    };
    made().inspect_err(|_| new_folders.iter().for_each(|folder| drop(fs::remove_dir(folder))))
}

/// Makes a file at `path`, or returns an error and leaves everything as it was. `write` gets a path of the same name in
/// another directory. A file that another process makes at `path` meanwhile is never replaced.
pub fn make_file(path: &Path, existing: Existing, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let name = path.file_name().with_context(failed)?;
    let staged = StagedDirectory::make_in(folder_of(path)).with_context(failed)?;
    write(&staged.directory().path_of(name)).with_context(failed)?;
    loop {
        clear(path, existing)?;
        if staged.move_file(name).with_context(failed)? {
            return Ok(());
        }
        ensure!(
            existing == Existing::MoveAside,
            "{}: exists already, made by another process meanwhile; name another file, or move it aside with --force",
            path.display()
        );
    }
}

/// Moves what is at `path` aside and says so, if `existing` asks for it. Errors: another process writes there.
pub fn clear(path: &Path, existing: Existing) -> Result<()> {
    if existing != Existing::MoveAside || is_free(path) {
        return Ok(());
    }
    let _held = if path.is_dir() { Some(Directory::lock(path)?) } else { None };
    check_nobody_writes(path, LEVELS)?;
    loop {
        let aside = first_free(path, ".old-", 1);
        let moved = rename_to_free(path, &aside);
        if moved.with_context(|| format!("{}: cannot be moved aside", path.display()))? {
            Directory::open(folder_of(path))?.sync()?;
            note(format_args!("moved {} to {}", path.display(), aside.display()));
            return Ok(());
        }
    }
}

/// Returns an error if another process writes a run within `path`. Follows no link.
fn check_nobody_writes(path: &Path, levels: usize) -> Result<()> {
    // What cannot be listed has no run of this user in it.
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    for folder in entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir())).map(|entry| entry.path()) {
        // A reader who asks the same holds the lock for a moment.
        ensure!(!Directory::is_locked(&folder) || Directory::lock(&folder).is_ok(), Busy(folder));
        if levels > 1 {
            check_nobody_writes(&folder, levels - 1)?;
        }
    }
    Ok(())
}

/// Returns the first free path of `path` + `word` + number.
fn first_free(path: &Path, word: &str, first: usize) -> PathBuf {
    let mut candidates = (first..).map(|number| {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!("{word}{number}"));
        path.with_file_name(name)
    });
    candidates.find(|candidate| is_free(candidate)).expect("numbers go on")
}

/// Returns whether nothing is at `path`, not even a broken link.
pub(crate) fn is_free(path: &Path) -> bool {
    path.symlink_metadata().is_err()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<std::ffi::OsString> {
        Directory::open(dir).unwrap().names().unwrap()
    }

    #[test]
    fn an_error_changes_nothing_and_leaves_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("run")).unwrap();
        for place in ["run", "new/and/deep"].map(|name| dir.path().join(name)) {
            make(&place, Existing::MoveAside, |_| anyhow::bail!("no such network")).unwrap_err();
            assert_eq!(names(dir.path()), ["run"]);
        }
    }

    #[test]
    fn a_place_that_is_taken_while_the_directory_is_filled_is_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run");
        let others = |_: &Directory| -> Result<()> {
            fs::create_dir(&path)?;
            Ok(fs::write(path.join("theirs"), "x")?)
        };
        let made = make(&path, Existing::Number, others).unwrap();
        assert_eq!(made.path(), dir.path().join("run-2"));
        fs::remove_dir_all(&path).unwrap();
        let error = make(&path, Existing::Refuse, others).unwrap_err().to_string();
        assert!(error.contains("run: exists already"), "{error}");
        fs::remove_dir_all(&path).unwrap();
        make(&path, Existing::MoveAside, others).unwrap();
        assert_eq!(names(dir.path()), ["run", "run-2", "run.old-1"]);
        assert!(path.with_file_name("run.old-1").join("theirs").exists());
    }

    #[test]
    fn a_file_that_appears_while_another_one_is_made_is_never_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("film.gif");
        let ours = |beside: &Path| {
            fs::write(&path, "theirs")?;
            Ok(fs::write(beside, "ours")?)
        };
        let error = format!("{:#}", make_file(&path, Existing::Refuse, ours).unwrap_err());
        assert!(error.contains("film.gif: exists already, made by another process meanwhile"), "{error}");
        assert_eq!(names(dir.path()), ["film.gif"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "theirs");
        make_file(&path, Existing::MoveAside, ours).unwrap();
        assert_eq!(names(dir.path()), ["film.gif", "film.gif.old-1"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "ours");
    }

    #[test]
    fn a_new_directory_has_a_name() {
        for nameless in ["..", "/", "a/..", ""] {
            let error = place(Path::new(nameless), Existing::MoveAside).unwrap_err().to_string();
            assert!(error.ends_with("has no name of its own; name a new directory"), "{error}");
        }
    }
}
