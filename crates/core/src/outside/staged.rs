//! Files and directories that appear whole or not at all, so that a kill, a full disk or a loss of power loses nothing.
//!
//! They are made in a directory of a temporary name beside their place, put on the disk and renamed. That directory is
//! locked while it is filled. So one that nobody holds was left behind by a kill, and the next write beside it removes it.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;
use tempfile::{Builder, TempDir};

use super::{Directory, Whereabouts};

/// Beginning of the temporary names, before letters and digits.
const STAGED: &str = ".dials-traffic-new-";
const RANDOM: usize = 6;

/// A new directory under a temporary name, locked. Dropping it removes it, unless it was moved to its place.
#[derive(Debug)]
pub struct StagedDirectory {
    directory: Directory,
    made: TempDir,
}

impl StagedDirectory {
    /// Makes a directory in `parent`. First sweeps what killed processes left there.
    pub fn make_in(parent: &Path) -> Result<StagedDirectory> {
        sweep(parent)?;
        loop {
            let made = Builder::new().prefix(STAGED).rand_bytes(RANDOM).tempdir_in(parent)?;
            let directory = match Directory::open(made.path()) {
                // Until it is locked, another process may sweep it.
                Err(_) if !made.path().exists() => continue,
                opened => opened?,
            };
            if directory.try_lock()? && directory.whereabouts() == Whereabouts::InPlace {
                return Ok(StagedDirectory { directory, made });
            }
        }
    }

    /// Returns the directory under its temporary name.
    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Moves files of the directory into its parent, in the place of those of the same names, once all of them are on
    /// the disk.
    pub(crate) fn replace(&self, names: &[impl AsRef<OsStr>]) -> Result<()> {
        let path = |name: &OsStr| self.directory.path_of(name);
        names.iter().try_for_each(|name| File::open(path(name.as_ref()))?.sync_all())?;
        let parent = self.parent();
        names.iter().try_for_each(|name| fs::rename(path(name.as_ref()), parent.join(name.as_ref())))?;
        Directory::open(parent)?.sync()
    }

    /// Moves a file of the directory into its parent, once all of it is on the disk. Returns whether its name was free
    /// there. If not, nothing has changed.
    pub fn move_file(&self, name: &OsStr) -> Result<bool> {
        let path = self.directory.path_of(name);
        File::open(&path)?.sync_all()?;
        let moved = rename_to_free(&path, &self.parent().join(name))?;
        Directory::open(self.parent())?.sync()?;
        Ok(moved)
    }

    /// Moves the directory to a free place in the same parent and returns it, still locked. If the place is taken:
    /// `None`, and nothing has changed.
    pub fn move_to(&mut self, place: &Path) -> Result<Option<Directory>> {
        let moved = rename_to_free(self.directory.path(), place);
        if !moved.with_context(|| format!("{}: cannot be made", place.display()))? {
            return Ok(None);
        }
        self.made.disable_cleanup(true);
        Directory::open(folder_of(place))?.sync()?;
        Ok(Some(self.directory.moved_to(place)))
    }

    fn parent(&self) -> &Path {
        folder_of(self.directory.path())
    }
}

/// Renames a file or a directory, but never over another one. Returns whether the new name was free.
pub fn rename_to_free(from: &Path, to: &Path) -> Result<bool> {
    match renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        Ok(()) => Ok(true),
        Err(Errno::EXIST) => Ok(false),
        // This file system cannot do it.
        Err(Errno::INVAL | Errno::NOSYS) if to.symlink_metadata().is_ok() => Ok(false),
        Err(Errno::INVAL | Errno::NOSYS) => Ok(fs::rename(from, to).map(|()| true)?),
        Err(error) => Err(error.into()),
    }
}

/// Removes the staged directories in `parent` that nobody holds.
pub fn sweep(parent: &Path) -> Result<()> {
    let entries = fs::read_dir(parent).with_context(|| format!("{}: cannot be listed", parent.display()))?;
    for entry in entries.flatten() {
        if !is_staged(&entry.file_name()) || !entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            continue;
        }
        // What cannot be opened, locked or removed belongs to somebody else, and harms nobody.
        let Ok(left_over) = Directory::open(&entry.path()) else { continue };
        if left_over.try_lock().unwrap_or(false) && left_over.whereabouts() == Whereabouts::InPlace {
            let _ = fs::remove_dir_all(left_over.path());
        }
    }
    Ok(())
}

fn is_staged(name: &OsStr) -> bool {
    let random = name.to_str().and_then(|name| name.strip_prefix(STAGED));
    random.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

/// Writes files into one directory, all of them or none, and makes the directory if there is none.
///
/// `files`: paths in `dir`, with their contents.
pub fn write_together(dir: &Path, files: &[(PathBuf, Vec<u8>)]) -> Result<()> {
    let unwritable =
        || format!("{}: could not be written to; make it writable or choose another directory", dir.display());
    fs::create_dir_all(dir).with_context(unwritable)?;
    for (path, _) in files {
        ensure!(!path.is_dir(), "{}: is a directory, but a file must be written there; move it away", path.display());
    }
    let names: Vec<&OsStr> = files.iter().filter_map(|(path, _)| path.file_name()).collect();
    let written = StagedDirectory::make_in(dir).and_then(|staged| {
        let mut contents = names.iter().zip(files);
        contents.try_for_each(|(name, (_, content))| fs::write(staged.directory().path_of(name), content))?;
        staged.replace(&names)
    });
    written.with_context(unwritable)
}

pub fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let names = Directory::open(dir).unwrap().names().unwrap();
        names.into_iter().map(|name| name.into_string().unwrap()).collect()
    }

    #[test]
    fn a_staged_directory_takes_a_free_place_and_keeps_its_lock() {
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().join(name);
        fs::create_dir(place("taken")).unwrap();
        let mut staged = StagedDirectory::make_in(dir.path()).unwrap();
        staged.directory().put("a", b"x").unwrap();
        assert!(staged.move_to(&place("taken")).unwrap().is_none(), "even an empty directory is not replaced");
        let moved = staged.move_to(&place("free")).unwrap().unwrap();
        drop(staged);
        assert_eq!(names(dir.path()), ["free", "taken"]);
        assert!(Directory::is_locked(&place("free")) && moved.check_in_place().is_ok());
        drop(moved);
        // Not `is_locked`: a child that another test begins shares the lock, until it has become its program.
        assert!(Directory::lock(&place("free")).is_ok());
        assert_eq!(fs::read(place("free/a")).unwrap(), b"x");
    }

    #[test]
    fn files_are_written_together_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let blocked = dir.path().join("b");
        fs::create_dir(&blocked).unwrap();
        let files = [(dir.path().join("a"), vec![1]), (blocked.clone(), vec![2])];
        let error = write_together(dir.path(), &files).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: is a directory", blocked.display())), "{error}");
        assert_eq!(names(dir.path()), ["b"]);
        fs::remove_dir(&blocked).unwrap();
        write_together(dir.path(), &files).unwrap();
        assert_eq!((fs::read(dir.path().join("a")).unwrap(), fs::read(&blocked).unwrap()), (vec![1], vec![2]));
    }
}
