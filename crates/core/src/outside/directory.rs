//! A directory that this program writes: its lock, and its files.
//!
//! One process at a time writes a run: the one that holds the lock of its directory. A file is replaced as a whole, or
//! appended to. In the place of a file, a link is an error: in an archive or a backup it leads to a file elsewhere.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Error, Result, bail};
use rustix::fs::OFlags;

use super::StagedDirectory;
use super::file::read_bytes;

/// Time between two attempts to lock a directory. A reader who asks whether it is locked holds it for a moment.
const AGAIN: Duration = Duration::from_millis(20);
const ATTEMPTS: u32 = 10;

/// An open directory. Its clones share its lock.
#[derive(Clone, Debug)]
pub struct Directory {
    opened: Arc<File>,
    path: PathBuf,
}

/// The error if another process writes a run. It passes: the same command works when that process has ended.
#[derive(Debug, thiserror::Error)]
#[error("{}: another process is writing this run; wait until it has ended, or name another directory", .0.display())]
pub struct Busy(pub PathBuf);

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Whereabouts {
    /// At the path by which it was opened.
    InPlace,
    Moved(PathBuf),
    Removed,
}

impl Directory {
    /// Opens a directory. The path itself may be a link.
    pub fn open(path: &Path) -> Result<Directory> {
        let flags = OFlags::DIRECTORY.bits().cast_signed();
        let opened = OpenOptions::new().read(true).custom_flags(flags).open(path);
        let opened = opened.with_context(|| format!("{}: cannot be opened as a directory", path.display()))?;
        Ok(Directory { opened: Arc::new(opened), path: path.to_owned() })
    }

    /// Opens a directory and locks it. As long as it or a clone is held, this process alone writes there. The system
    /// releases the lock when the process ends, in whatever way.
    pub fn lock(path: &Path) -> Result<Directory> {
        for _ in 0..ATTEMPTS {
            let directory = Directory::open(path)?;
            if !directory.try_lock()? {
                thread::sleep(AGAIN);
            } else if directory.whereabouts() == Whereabouts::InPlace {
                return Ok(directory);
            } // Otherwise it was moved aside before it was locked.
        }
        Err(Busy(path.to_owned()).into())
    }

    /// Tries to lock the directory. Returns whether this process may write there.
    pub(super) fn try_lock(&self) -> Result<bool> {
        match self.opened.try_lock() {
            Ok(()) => Ok(true),
            Err(TryLockError::WouldBlock) => Ok(false),
            Err(TryLockError::Error(error)) => Err(error).with_context(|| {
                let path = self.path.display();
                format!("{path}: cannot be locked; use a directory on a file system that has locks (flock)")
            }),
        }
    }

    /// Returns whether somebody holds the lock of the directory at a path. What cannot be opened is not locked.
    pub fn is_locked(path: &Path) -> bool {
        Directory::open(path)
            .is_ok_and(|directory| matches!(directory.opened.try_lock_shared(), Err(TryLockError::WouldBlock)))
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the same directory, which was moved to `path`.
    pub(super) fn moved_to(&self, path: &Path) -> Directory {
        Directory { path: path.to_owned(), ..self.clone() }
    }

    pub fn whereabouts(&self) -> Whereabouts {
        let is_here = |path: &Path| match (fs::metadata(path), self.opened.metadata()) {
            (Ok(there), Ok(own)) => (there.dev(), there.ino()) == (own.dev(), own.ino()),
            _ => false,
        };
        if is_here(&self.path) {
            return Whereabouts::InPlace;
        }
        // The system knows the path of an open file.
        match fs::read_link(format!("/proc/self/fd/{}", self.opened.as_raw_fd())) {
            Ok(place) if is_here(&place) => Whereabouts::Moved(place),
            _ => Whereabouts::Removed,
        }
    }

    /// Returns an error if the directory is no longer at its path.
    pub fn check_in_place(&self) -> Result<()> {
        let path = self.path.display();
        match self.whereabouts() {
            Whereabouts::InPlace => Ok(()),
            Whereabouts::Moved(place) => bail!("{path}: was moved to {} while this run was written", place.display()),
            Whereabouts::Removed => bail!("{path}: was removed while this run was written"),
        }
    }

    pub fn path_of(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path.join(name)
    }

    /// Lists the names of all entries, in order.
    pub fn names(&self) -> Result<Vec<OsString>> {
        let entries = fs::read_dir(&self.path).and_then(|all| all.map(|entry| Ok(entry?.file_name())).collect());
        let mut names: Vec<OsString> = entries.with_context(|| format!("{}: cannot be listed", self.path.display()))?;
        names.sort();
        Ok(names)
    }

    /// Opens a directory within this one; `None` if there is none. A link to one is an error.
    pub fn subdirectory(&self, name: &str) -> Result<Option<Directory>> {
        let path = self.path_of(name);
        let Some(about) = self.if_there(path.symlink_metadata(), name, "cannot be opened")? else { return Ok(None) };
        if about.is_dir() {
            return Directory::open(&path).map(Some);
        }
        let what = if about.is_symlink() { "is a link" } else { "is no directory" };
        bail!("{}: {what}, and this program writes only into directories of its own: move it away", path.display())
    }

    /// Opens a directory within this one, and makes it if there is none.
    pub fn make_subdirectory(&self, name: &str) -> Result<Directory> {
        if let Some(there) = self.subdirectory(name)? {
            return Ok(there);
        }
        let path = self.path_of(name);
        fs::create_dir(&path).map_err(|error| self.failed(error.into(), name, "cannot be made"))?;
        self.sync()?;
        Directory::open(&path)
    }

    /// Makes new names and new places durable.
    pub fn sync(&self) -> Result<()> {
        match self.opened.sync_all() {
            // Some file systems cannot do this for a directory.
            Err(error) if error.kind() != ErrorKind::InvalidInput => {
                Err(error).with_context(|| format!("{}: cannot be written", self.path.display()))
            }
            _ => Ok(()),
        }
    }

    /// Makes all files in this directory and below durable.
    pub fn sync_tree(&self) -> Result<()> {
        for path in self.names()?.into_iter().map(|name| self.path_of(name)) {
            if path.is_dir() {
                Directory::open(&path)?.sync_tree()?;
            } else {
                let synced = File::open(&path).and_then(|file| file.sync_all());
                synced.with_context(|| format!("{}: cannot be written", path.display()))?;
            }
        }
        self.sync()
    }

    /// Checks that nothing but a regular file with one name stands at `name`, if anything does.
    pub fn check(&self, name: &str) -> Result<()> {
        let path = self.path_of(name);
        let Some(about) = self.if_there(path.symlink_metadata(), name, "cannot be read")? else { return Ok(()) };
        let what = match about.nlink() {
            0 | 1 if about.is_file() => return Ok(()),
            names if about.is_file() => format!("has {names} names (hard links)"),
            _ if about.is_symlink() => "is a link".to_owned(),
            _ => "is not a regular file".to_owned(),
        };
        bail!(
            "{}: {what}, and this program uses only files of its own here: move it away, and put a copy of the file in \
             its place if it is needed",
            path.display()
        )
    }

    /// Opens a file for reading; `None` if there is none.
    pub fn open_file(&self, name: &str) -> Result<Option<File>> {
        self.check(name)?;
        self.if_there(File::open(self.path_of(name)), name, "cannot be opened")
    }

    /// Reads a whole file of at most `at_most` bytes; `None` if there is none.
    pub fn read(&self, name: &str, at_most: u64) -> Result<Option<Vec<u8>>> {
        self.check(name)?;
        self.if_there(read_bytes(&self.path_of(name), at_most), name, "cannot be read")
    }

    /// Opens a file to append to and to read from, and makes it if there is none.
    pub fn open_to_append(&self, name: &str) -> Result<File> {
        self.open_with(name, OpenOptions::new().read(true).append(true).create(true))
    }

    /// Opens a file to append to and to read from. If there is none, this is an error.
    pub fn open_to_go_on(&self, name: &str) -> Result<File> {
        self.open_with(name, OpenOptions::new().read(true).append(true))
    }

    fn open_with(&self, name: &str, how: &OpenOptions) -> Result<File> {
        self.check_in_place()?;
        self.check(name)?;
        how.open(self.path_of(name)).map_err(|error| self.failed(error.into(), name, "cannot be opened"))
    }

    /// Writes a file into a directory that nobody reads yet. Only [`Directory::sync_tree`] makes it durable.
    pub fn put(&self, name: &str, bytes: &[u8]) -> Result<()> {
        fs::write(self.path_of(name), bytes).map_err(|error| self.failed(error.into(), name, "cannot be written"))
    }

    /// Replaces a file. Readers see the old file or the new one, never a part, also after a loss of power.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.write_with(name, |beside| Ok(fs::write(beside, bytes)?))
    }

    /// Does the same as [`Directory::write`], for a `write` that makes the file itself. It gets a path of the same name
    /// in another directory.
    pub fn write_with(&self, name: &str, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
        self.check_in_place()?;
        self.check(name)?;
        let written = StagedDirectory::make_in(&self.path).and_then(|staged| {
            write(&staged.directory().path_of(name))?;
            staged.replace(&[name])
        });
        written.map_err(|error| self.failed(error, name, "cannot be written"))
    }

    /// Removes a file or a link, never what a link leads to. If there is none, nothing happens.
    pub fn remove(&self, name: &str) -> Result<()> {
        self.if_there(fs::remove_file(self.path_of(name)), name, "cannot be removed").map(drop)
    }

    /// Returns the outcome of an operation on an entry; `None` if there is no such entry.
    fn if_there<T>(&self, outcome: io::Result<T>, name: &str, failure: &str) -> Result<Option<T>> {
        match outcome {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            outcome => outcome.map(Some).map_err(|error| self.failed(error.into(), name, failure)),
        }
    }

    /// Returns the error of an operation. If the directory itself has gone, the error says so instead.
    fn failed(&self, error: Error, name: &str, what: &str) -> Error {
        match self.check_in_place() {
            Err(gone) => gone,
            Ok(()) => error.context(format!("{}: {what}", self.path_of(name).display())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn error<T>(outcome: Result<T>) -> String {
        format!("{:#}", outcome.err().expect("it is refused"))
    }

    #[test]
    fn a_file_is_replaced_as_a_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let directory = Directory::open(dir.path()).unwrap();
        fs::write(dir.path().join("plain"), "").unwrap();
        directory.write("a", b"old").unwrap();
        let mode = |name: &str| fs::metadata(dir.path().join(name)).unwrap().permissions().mode();
        assert_eq!(mode("a"), mode("plain"), "the umask decides who may read it");
        let torn = directory.write_with("a", |beside| {
            fs::write(beside, "ne")?;
            Ok(fs::write("/dev/full", "w")?)
        });
        assert!(error(torn).contains("a: cannot be written: No space left on device"));
        assert_eq!(directory.read("a", 3).unwrap().unwrap(), b"old");
        assert!(error(directory.read("a", 2)).contains("a: cannot be read: it has more than 2 bytes, the limit"));
        assert_eq!(directory.read("b", 3).unwrap(), None);
        assert_eq!(directory.names().unwrap(), ["a", "plain"], "no temporary file remains");
    }
}
