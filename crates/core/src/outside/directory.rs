//! A directory that others can reach too. It is opened once, and its files are reached through it alone.
//!
//! Its path may lead elsewhere in the meantime, and a directory in it may have been replaced by a link.

use std::ffi::{OsStr, OsString};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Error, Result, anyhow, bail};
use rustix::fs::{
    AtFlags, CWD, Dir, FileType, FlockOperation, Mode, OFlags, Stat, flock, fstat, mkdirat, openat, stat, statat,
    unlinkat,
};
use rustix::io::Errno;

use super::own_files::single;

/// Time between two attempts to lock a directory. A reader who asks whether it is locked holds it for a moment.
const AGAIN: Duration = Duration::from_millis(20);
const ATTEMPTS: u32 = 10;

/// An open directory. Its clones are the same opened directory, and share its lock.
#[derive(Clone, Debug)]
pub struct Directory {
    opened: Arc<OwnedFd>,
    /// Path by which it was opened, for messages.
    path: PathBuf,
}

/// The error if another process writes a run. It passes: the same command works when that process has ended.
#[derive(Debug, thiserror::Error)]
#[error("{}: another process is writing this run; wait until it has ended, or name another directory", .0.display())]
pub struct Busy(pub PathBuf);

/// Where an opened directory is now.
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
        let opened = openat(CWD, path, OFlags::DIRECTORY | OFlags::RDONLY | OFlags::CLOEXEC, Mode::empty());
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
        match flock(&self.opened, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Ok(true),
            Err(Errno::WOULDBLOCK) => Ok(false),
            Err(error) => Err(cannot_be_locked(error, &self.path)),
        }
    }

    /// Returns whether somebody holds the lock of the directory at a path. What cannot be opened is not locked.
    pub fn is_locked(path: &Path) -> bool {
        let shared = |directory: Directory| flock(&directory.opened, FlockOperation::NonBlockingLockShared);
        Directory::open(path).is_ok_and(|directory| shared(directory) == Err(Errno::WOULDBLOCK))
    }

    /// Returns the path by which it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the same directory, which was moved to `path`.
    pub fn moved_to(self, path: &Path) -> Directory {
        Directory { path: path.to_owned(), ..self }
    }

    pub fn whereabouts(&self) -> Whereabouts {
        let here = |path: &Path| match (stat(path), fstat(&self.opened)) {
            (Ok(there), Ok(own)) => (there.st_dev, there.st_ino) == (own.st_dev, own.st_ino),
            _ => false,
        };
        if here(&self.path) {
            return Whereabouts::InPlace;
        }
        match std::fs::read_link(self.reached_while_open()) {
            Ok(place) if here(&place) => Whereabouts::Moved(place),
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

    /// Returns the path of an entry, for messages.
    pub fn path_of(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path.join(name.as_ref())
    }

    /// Lists the names of all entries, in order.
    pub fn names(&self) -> Result<Vec<OsString>> {
        let failed = || format!("{}: cannot be listed", self.path.display());
        let mut names = Vec::new();
        for entry in Dir::read_from(&self.opened).with_context(failed)? {
            let entry = entry.with_context(failed)?;
            names.push(OsStr::from_bytes(entry.file_name().to_bytes()).to_owned());
        }
        names.retain(|name| name != "." && name != "..");
        names.sort();
        Ok(names)
    }

    /// Opens a directory within this one; `None` if there is none. A link to one is an error.
    pub fn subdirectory(&self, name: &str) -> Result<Option<Directory>> {
        let flags = OFlags::DIRECTORY | OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let path = self.path_of(name);
        match openat(&self.opened, single(name)?, flags, Mode::empty()) {
            Ok(opened) => Ok(Some(Directory { opened: Arc::new(opened), path })),
            Err(Errno::NOENT) => Ok(None),
            Err(Errno::LOOP | Errno::NOTDIR) => {
                let what = if self.kind_of(name)? == Some(FileType::Symlink) { "is a link" } else { "is no directory" };
                bail!(
                    "{}: {what}, and this program writes only into directories of its own: move it away",
                    path.display()
                )
            }
            Err(error) => Err(error).with_context(|| format!("{}: cannot be opened", path.display())),
        }
    }

    /// Opens a directory within this one, and makes it if there is none.
    pub fn make_subdirectory(&self, name: &str) -> Result<Directory> {
        if let Some(there) = self.subdirectory(name)? {
            return Ok(there);
        }
        match mkdirat(&self.opened, single(name)?, Mode::from(0o777)) {
            Ok(()) | Err(Errno::EXIST) => {}
            Err(error) => return Err(self.failed(error.into(), name, "cannot be made")),
        }
        self.sync()?;
        let made = self.subdirectory(name)?;
        made.with_context(|| format!("{}: was removed while it was made", self.path_of(name).display()))
    }

    /// Makes all files in this directory and below durable.
    pub fn sync_tree(&self) -> Result<()> {
        for name in self.names()? {
            let Some(name) = name.to_str() else { continue };
            match self.kind_of(name)? {
                Some(FileType::Directory) => self.subdirectory(name)?.map_or(Ok(()), |within| within.sync_tree())?,
                Some(FileType::RegularFile) => {
                    let failed = || format!("{}: cannot be written", self.path_of(name).display());
                    self.open_file(name)?.map_or(Ok(()), |file| file.sync_all()).with_context(failed)?;
                }
                _ => {}
            }
        }
        self.sync()
    }

    /// Makes new names and new places durable.
    pub fn sync(&self) -> Result<()> {
        match rustix::fs::fsync(&self.opened) {
            // Some file systems cannot do this for a directory.
            Ok(()) | Err(Errno::INVAL) => Ok(()),
            Err(error) => Err(error).with_context(|| format!("{}: cannot be written", self.path.display())),
        }
    }

    /// Returns the kind of an entry itself; `None` if there is none.
    pub(super) fn kind_of(&self, name: impl AsRef<OsStr>) -> Result<Option<FileType>> {
        match statat(&self.opened, name.as_ref(), AtFlags::SYMLINK_NOFOLLOW) {
            Ok(stat) => Ok(Some(FileType::from_raw_mode(stat.st_mode))),
            Err(Errno::NOENT) => Ok(None),
            Err(error) => {
                Err(error).with_context(|| format!("{}: cannot be read", self.path_of(name.as_ref()).display()))
            }
        }
    }

    /// Removes an empty directory within this one.
    pub(super) fn remove_empty(&self, name: &str) -> Result<()> {
        unlinkat(&self.opened, name, AtFlags::REMOVEDIR)
            .with_context(|| format!("{}: cannot be removed", self.path_of(name).display()))
    }

    pub(super) fn stat(&self) -> Result<Stat> {
        fstat(&self.opened).with_context(|| format!("{}: cannot be read", self.path.display()))
    }

    /// Returns the error of an operation. If the directory itself has gone, the error says so instead.
    pub(super) fn failed(&self, error: Error, name: &str, what: &str) -> Error {
        match self.check_in_place() {
            Err(gone) => gone,
            Ok(()) => error.context(format!("{}: {what}", self.path_of(name).display())),
        }
    }

    /// Returns a path by which this process reaches the directory as long as it is open, wherever it is moved.
    pub(super) fn reached_while_open(&self) -> PathBuf {
        PathBuf::from(format!("/proc/self/fd/{}", self.opened.as_raw_fd()))
    }
}

impl AsFd for Directory {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.opened.as_fd()
    }
}

/// Returns the error about a directory that could not be locked.
fn cannot_be_locked(error: Errno, path: &Path) -> Error {
    let place = path.display();
    match error {
        // What the file systems of Linux answer that keep no locks, among them some of networks and of containers.
        Errno::NOLCK | Errno::NOSYS | Errno::OPNOTSUPP | Errno::INVAL | Errno::BADF => {
            let way_out = "use a directory on another file system, or mount this one with locks";
            anyhow!(error).context(format!("{place}: its file system cannot lock directories; {way_out}"))
        }
        _ => anyhow!(error).context(format!("{place}: cannot be locked")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn error<T>(outcome: Result<T>) -> String {
        format!("{:#}", outcome.err().expect("it is refused"))
    }

    #[test]
    fn a_directory_that_goes_away_is_followed_and_its_path_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().canonicalize().unwrap().join(name);
        fs::create_dir(place("run")).unwrap();
        let directory = Directory::lock(&place("run")).unwrap();
        assert_eq!(directory.whereabouts(), Whereabouts::InPlace);
        assert!(error(Directory::lock(&place("run"))).contains("run: another process is writing this run"));
        fs::rename(place("run"), place("elsewhere")).unwrap();
        fs::create_dir(place("run")).unwrap();
        assert_eq!(directory.whereabouts(), Whereabouts::Moved(place("elsewhere")));
        directory.write("a", b"x").unwrap();
        assert!(place("elsewhere/a").exists() && !place("run/a").exists());
        assert!(error(directory.check_in_place()).contains("run: was moved to "));
        fs::remove_dir_all(place("elsewhere")).unwrap();
        assert!(error(directory.write("a", b"x")).contains("run: was removed while this run was written"));
        assert!(error(directory.open_to_append("a")).contains("run: was removed while this run was written"));
    }
    #[test]
    fn a_file_system_without_locks_is_an_error_with_a_way_out() {
        let told = |errno| format!("{:#}", cannot_be_locked(errno, Path::new("runs/a")));
        for errno in [Errno::NOLCK, Errno::NOSYS, Errno::OPNOTSUPP, Errno::INVAL] {
            let told = told(errno);
            assert!(told.starts_with("runs/a: its file system cannot lock directories; use a directory on"), "{told}");
        }
        assert!(told(Errno::IO).starts_with("runs/a: cannot be locked: "), "{}", told(Errno::IO));
    }
}
