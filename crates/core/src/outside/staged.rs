//! What is made in a directory of a temporary name and then moved to its place, and the sweeping of what a kill left.
//!
//! The name says that it is of this program. The directory is locked as long as it is filled. So one that nobody has
//! locked is left over.

use std::ffi::OsStr;
use std::path::Path;

use anyhow::{Context, Result};
use rand::distr::{Alphanumeric, SampleString};
use rustix::fs::{
    AtFlags, FileType, Mode, OFlags, RenameFlags, fsync, mkdirat, openat, renameat_with, statat, unlinkat,
};
use rustix::io::Errno;
use rustix::process::geteuid;

use super::Directory;

/// Beginning of the temporary names, before six letters and digits.
const STAGED: &str = ".dials-traffic-new-";
/// Beginning of the names of the folders that earlier versions wrote a single file in.
const STAGED_EARLIER: &str = ".new-";
const RANDOM: usize = 6;

/// Returns a new temporary name.
fn staged_name() -> String {
    format!("{STAGED}{}", Alphanumeric.sample_string(&mut rand::rng(), RANDOM))
}

fn is_staged(name: &str, beginning: &str) -> bool {
    let random = name.strip_prefix(beginning);
    random.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

/// A new directory under a temporary name, locked. Dropping it removes it, unless it was moved to its place.
#[derive(Debug)]
pub struct StagedDirectory {
    parent: Directory,
    name: String,
    directory: Directory,
    placed: bool,
}

impl StagedDirectory {
    /// Makes a directory in `parent`. First sweeps what killed processes left there.
    pub fn make_in(parent: &Directory) -> Result<StagedDirectory> {
        sweep_directories(parent)?;
        loop {
            let name = staged_name();
            match mkdirat(parent, &name, Mode::from(0o777)) {
                Ok(()) => {}
                Err(Errno::EXIST) => continue,
                Err(error) => return Err(error.into()),
            }
            // Until it is locked, another process may sweep it.
            let Some(directory) = parent.subdirectory(&name)? else { continue };
            let locked = directory.try_lock().inspect_err(|_| drop(parent.remove_empty(&name)))?;
            if locked && is_at(parent, &name, &directory) {
                return Ok(StagedDirectory { parent: parent.clone(), name, directory, placed: false });
            }
        }
    }

    /// Returns the directory under its temporary name.
    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Moves a file of the directory into the parent, once all of it is on the disk. Returns whether its name was free
    /// there. If not, nothing has changed.
    pub fn move_file(&self, name: &OsStr) -> Result<bool> {
        fsync(openat(&self.directory, name, OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::CLOEXEC, Mode::empty())?)?;
        let moved = rename_between(&self.directory, name, &self.parent, name)?;
        if moved {
            self.parent.sync()?;
        }
        Ok(moved)
    }

    /// Moves the directory to a free place in the same parent and returns it, still locked. If the place is taken:
    /// `None`, and nothing has changed.
    pub fn move_to(&mut self, place: &Path) -> Result<Option<Directory>> {
        let failed = || format!("{}: cannot be made", place.display());
        let name = place.file_name().with_context(failed)?;
        if !rename_to_free(&self.parent, self.name.as_ref(), name).with_context(failed)? {
            return Ok(None);
        }
        self.placed = true;
        self.parent.sync()?;
        Ok(Some(self.directory.clone().moved_to(place)))
    }
}

impl Drop for StagedDirectory {
    fn drop(&mut self) {
        if !self.placed {
            // If this fails, the next process sweeps it.
            let _ = empty(&self.directory).and_then(|()| self.parent.remove_empty(&self.name));
        }
    }
}

/// Renames an entry of a directory, but never over another one. Returns whether the new name was free.
pub fn rename_to_free(folder: &Directory, from: &OsStr, to: &OsStr) -> Result<bool> {
    rename_between(folder, from, folder, to)
}

fn rename_between(folder: &Directory, from: &OsStr, other: &Directory, to: &OsStr) -> Result<bool> {
    match renameat_with(folder, from, other, to, RenameFlags::NOREPLACE) {
        Ok(()) => Ok(true),
        Err(Errno::EXIST) => Ok(false),
        // This file system cannot do it. A full directory is not replaced here either.
        Err(Errno::INVAL | Errno::NOSYS) => {
            if other.kind_of(to)?.is_some() {
                return Ok(false);
            }
            match rustix::fs::renameat(folder, from, other, to) {
                Ok(()) => Ok(true),
                Err(Errno::EXIST | Errno::NOTEMPTY) => Ok(false),
                Err(error) => Err(error.into()),
            }
        }
        Err(error) => Err(error.into()),
    }
}

/// Removes what killed writes left in a directory of a run, which the caller has locked.
///
/// Earlier versions wrote a file under a temporary name, or in a folder of its own. Such a folder is removed if it
/// holds nothing but files that `is_ours` knows by their names.
pub fn sweep(directory: &Directory, is_ours: impl Fn(&str) -> bool) -> Result<()> {
    sweep_directories(directory)?;
    for name in directory.names()? {
        let Some(name) = name.to_str() else { continue };
        match directory.kind_of(name)? {
            Some(FileType::RegularFile) if is_staged(name, STAGED) => directory.remove(name)?,
            Some(FileType::Directory) if is_staged(name, STAGED_EARLIER) => {
                let Some(folder) = directory.subdirectory(name)? else { continue };
                let files = folder.names()?;
                let ours = |file: &OsStr| {
                    file.to_str().is_some_and(&is_ours)
                        && folder.kind_of(file).is_ok_and(|kind| kind == Some(FileType::RegularFile))
                };
                if !files.is_empty() && files.iter().all(|file| ours(file)) {
                    empty(&folder)?;
                    directory.remove_empty(name)?;
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// Removes the staged directories of this user in `parent` that nobody has locked. Leaves those on a file system that
/// cannot lock them.
fn sweep_directories(parent: &Directory) -> Result<()> {
    for name in parent.names()? {
        let Some(name) = name.to_str().filter(|name| is_staged(name, STAGED)) else { continue };
        if parent.kind_of(name)? != Some(FileType::Directory) {
            continue;
        }
        // What cannot be opened or locked belongs to somebody else.
        let Ok(Some(left_over)) = parent.subdirectory(name) else { continue };
        let ours = left_over.stat()?.st_uid == geteuid().as_raw();
        if ours && left_over.try_lock().unwrap_or(false) && is_at(parent, name, &left_over) {
            // What cannot be removed stays, and harms nobody.
            let _ = empty(&left_over).and_then(|()| parent.remove_empty(name));
        }
    }
    Ok(())
}

/// Returns whether the name still leads to the directory that was opened by it.
fn is_at(parent: &Directory, name: &str, directory: &Directory) -> bool {
    match (statat(parent, name, AtFlags::SYMLINK_NOFOLLOW), directory.stat()) {
        (Ok(there), Ok(own)) => (there.st_dev, there.st_ino) == (own.st_dev, own.st_ino),
        _ => false,
    }
}

/// Removes everything in a directory. Follows no link.
fn empty(directory: &Directory) -> Result<()> {
    for name in directory.names()? {
        let failed = || format!("{}: cannot be removed", directory.path_of(&name).display());
        match (directory.kind_of(&name)?, name.to_str()) {
            (Some(FileType::Directory), Some(name)) => {
                directory.subdirectory(name)?.map_or(Ok(()), |within| empty(&within))?;
                directory.remove_empty(name)?;
            }
            _ => unlinkat(directory, &name, AtFlags::empty()).with_context(failed)?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    fn names(dir: &Path) -> Vec<String> {
        let directory = Directory::open(dir).unwrap();
        directory.names().unwrap().into_iter().map(|name| name.into_string().unwrap()).collect()
    }

    fn staged_in(dir: &Path) -> StagedDirectory {
        StagedDirectory::make_in(&Directory::open(dir).unwrap()).unwrap()
    }

    #[test]
    fn only_names_of_this_program_are_temporary() {
        assert!(is_staged(&staged_name(), STAGED));
        for other in [".dials-traffic-new-", ".dials-traffic-new-12345", ".dials-traffic-new-1234567", ".new-123456"] {
            assert!(!is_staged(other, STAGED), "{other}");
        }
        assert!(!is_staged(".dials-traffic-new-ab.cde", STAGED));
    }

    #[test]
    fn a_staged_directory_takes_a_free_place_and_keeps_its_lock() {
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().join(name);
        fs::create_dir(place("taken")).unwrap();
        let mut staged = staged_in(dir.path());
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
    fn what_is_not_placed_is_removed_and_what_is_in_use_is_not_swept() {
        let dir = tempfile::tempdir().unwrap();
        let outside = tempfile::tempdir().unwrap();
        fs::write(outside.path().join("precious"), "x").unwrap();
        let first = staged_in(dir.path());
        let networks = first.directory().make_subdirectory("networks").unwrap();
        symlink(outside.path(), networks.path_of("link")).unwrap();
        let second = staged_in(dir.path());
        assert_eq!(names(dir.path()).len(), 2, "the first is locked, so it stays");
        drop((first, second));
        assert_eq!(names(dir.path()), [""; 0]);
        assert!(outside.path().join("precious").exists());
    }
}
