//! A directory that others can reach too. It is opened once, and its files are reached through it alone.
//!
//! Its path may lead elsewhere in the meantime, and a file in it may have been replaced by a link. So no file is
//! opened, replaced or removed by its path, and none but a regular file with one name.

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Error, Result, anyhow, bail};
use rustix::fs::{
    AtFlags, CWD, Dir, FileType, FlockOperation, Mode, OFlags, Stat, flock, fstat, mkdirat, openat, renameat, stat,
    statat, unlinkat,
};
use rustix::io::Errno;

use super::staged::staged_name;

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
            Err(error) => Err(error).with_context(|| format!("{}: cannot be locked", self.path.display())),
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
        match std::fs::read_link(self.own_path(&self.opened)) {
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

    /// Checks that nothing but a regular file with one name stands at `name`, if anything does.
    pub fn check(&self, name: &str) -> Result<()> {
        match statat(&self.opened, single(name)?, AtFlags::SYMLINK_NOFOLLOW) {
            Ok(stat) => check_own(&stat, &self.path_of(name)),
            Err(Errno::NOENT) => Ok(()),
            Err(error) => Err(self.failed(error.into(), name, "cannot be read")),
        }
    }

    /// Opens a file for reading; `None` if there is none.
    pub fn open_file(&self, name: &str) -> Result<Option<File>> {
        match self.open_own(name, OFlags::RDONLY) {
            Ok(file) => Ok(Some(file)),
            Err(error) if is_not_found(&error) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Reads a whole file of at most `at_most` bytes; `None` if there is none.
    pub fn read(&self, name: &str, at_most: u64) -> Result<Option<Vec<u8>>> {
        let Some(file) = self.open_file(name)? else { return Ok(None) };
        let mut bytes = Vec::new();
        let failed = || format!("{}: cannot be read", self.path_of(name).display());
        file.take(at_most.saturating_add(1)).read_to_end(&mut bytes).with_context(failed)?;
        if bytes.len() as u64 > at_most {
            bail!("{}: has more than {at_most} bytes, the limit", self.path_of(name).display());
        }
        Ok(Some(bytes))
    }

    /// Opens a file to append to and to read from, and makes it if there is none.
    pub fn open_to_append(&self, name: &str) -> Result<File> {
        self.open_own(name, OFlags::RDWR | OFlags::APPEND | OFlags::CREATE)
    }

    /// Opens a file to append to and to read from. If there is none, this is an error.
    pub fn open_to_go_on(&self, name: &str) -> Result<File> {
        self.open_own(name, OFlags::RDWR | OFlags::APPEND)
    }

    /// Opens a new, empty file in the place of `name`.
    pub fn open_anew(&self, name: &str) -> Result<File> {
        let file = self.open_own(name, OFlags::RDWR | OFlags::CREATE)?;
        file.set_len(0).with_context(|| format!("{}: cannot be written", self.path_of(name).display()))?;
        Ok(file)
    }

    /// Replaces a file. Readers see the old file or the new one, never a part, also after a loss of power.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.write_with(name, |_, mut file| Ok(file.write_all(bytes)?))
    }

    /// Does the same as [`Directory::write`], with a `write` that gets a file beside the place, and its path.
    pub fn write_with(&self, name: &str, write: impl FnOnce(&Path, &File) -> Result<()>) -> Result<()> {
        self.check(name)?;
        let (beside, file) = self.open_beside(name)?;
        let placed = write(&self.own_path(&file), &file)
            .and_then(|()| Ok(file.sync_all()?))
            .and_then(|()| Ok(renameat(&self.opened, &beside, &self.opened, name)?));
        if let Err(error) = placed {
            // If this fails too, the next one who locks the directory sweeps it.
            let _ = unlinkat(&self.opened, &beside, AtFlags::empty());
            return Err(self.failed(error, name, "cannot be written"));
        }
        self.sync()
    }

    /// Makes a file under a temporary name.
    fn open_beside(&self, name: &str) -> Result<(String, File)> {
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        loop {
            let beside = staged_name();
            match openat(&self.opened, &beside, flags, Mode::from(0o666)) {
                Ok(file) => return Ok((beside, File::from(file))),
                Err(Errno::EXIST) => {}
                Err(error) => return Err(self.failed(error.into(), name, "cannot be written")),
            }
        }
    }

    /// Removes a file or a link, never what a link leads to. If there is none, nothing happens.
    pub fn remove(&self, name: &str) -> Result<()> {
        match unlinkat(&self.opened, single(name)?, AtFlags::empty()) {
            Ok(()) | Err(Errno::NOENT) => Ok(()),
            Err(error) => Err(self.failed(error.into(), name, "cannot be removed")),
        }
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

    fn open_own(&self, name: &str, how: OFlags) -> Result<File> {
        self.check(name)?;
        // Opening a pipe waits for its other end, but for this flag.
        let flags = how | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file = match openat(&self.opened, single(name)?, flags, Mode::from(0o666)) {
            Ok(file) => File::from(file),
            Err(error) => {
                self.check(name)?; // It was replaced in between.
                return Err(self.failed(error.into(), name, "cannot be opened"));
            }
        };
        check_own(&fstat(&file)?, &self.path_of(name))?;
        Ok(file)
    }

    /// Returns the error of an operation. If the directory itself has gone, the error says so instead.
    fn failed(&self, error: Error, name: &str, what: &str) -> Error {
        match self.check_in_place() {
            Err(gone) => gone,
            Ok(()) => error.context(format!("{}: {what}", self.path_of(name).display())),
        }
    }

    /// Returns a path that leads to an opened file as long as it is open.
    fn own_path(&self, file: impl AsFd) -> PathBuf {
        PathBuf::from(format!("/proc/self/fd/{}", file.as_fd().as_raw_fd()))
    }
}

impl AsFd for Directory {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.opened.as_fd()
    }
}

/// Returns a name that leads nowhere but to an entry of a directory itself.
fn single(name: &str) -> Result<&str> {
    let mut parts = Path::new(name).components();
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(part)), None) if part == name => Ok(name),
        _ => Err(anyhow!("{name:?}: is not the name of a file in a directory; choose one without `/`")),
    }
}

/// Checks that a file is reached by its name alone, so that nobody else's file is written.
fn check_own(stat: &Stat, path: &Path) -> Result<()> {
    let what = match FileType::from_raw_mode(stat.st_mode) {
        FileType::RegularFile if stat.st_nlink <= 1 => return Ok(()),
        FileType::RegularFile => format!("has {} names (hard links)", stat.st_nlink),
        FileType::Symlink => "is a link".to_owned(),
        _ => "is not a regular file".to_owned(),
    };
    bail!(
        "{}: {what}, and this program uses only files of its own here: move it away, and put a copy of the file in its \
         place if it is needed",
        path.display()
    )
}

fn is_not_found(error: &Error) -> bool {
    error.downcast_ref::<Errno>() == Some(&Errno::NOENT)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::{PermissionsExt, symlink};

    use rustix::fs::mknodat;

    fn error<T>(outcome: Result<T>) -> String {
        format!("{:#}", outcome.err().expect("it is refused"))
    }

    #[test]
    fn nothing_but_a_file_of_its_own_is_opened_or_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let (directory, outside) = (Directory::open(dir.path()).unwrap(), tempfile::NamedTempFile::new().unwrap());
        fs::write(outside.path(), "precious").unwrap();
        let path = |name: &str| dir.path().join(name);
        symlink(outside.path(), path("link")).unwrap();
        symlink("/nowhere/at/all", path("broken")).unwrap();
        fs::write(path("file"), "x").unwrap();
        fs::hard_link(path("file"), path("second")).unwrap();
        mknodat(CWD, path("pipe"), FileType::Fifo, 0o600.into(), 0).unwrap();
        for (name, what) in [
            ("link", "link: is a link"),
            ("broken", "broken: is a link"),
            ("second", "second: has 2 names (hard links)"),
            ("pipe", "pipe: is not a regular file"),
        ] {
            let errors = [
                error(directory.check(name)),
                error(directory.open_file(name)),
                error(directory.open_to_append(name)),
                error(directory.open_anew(name)),
                error(directory.write(name, b"new")),
            ];
            for error in errors {
                assert!(error.contains(what) && error.contains("move it away"), "{error}");
            }
        }
        symlink(outside.path().parent().unwrap(), path("folder")).unwrap();
        assert!(error(directory.make_subdirectory("folder")).contains("folder: is a link"));
        directory.remove("link").unwrap();
        assert!(outside.path().exists() && !path("link").exists() && path("pipe").exists());
        assert_eq!(fs::read(outside.path()).unwrap(), b"precious");
        assert_eq!(fs::read(path("file")).unwrap(), b"x");
    }

    #[test]
    fn a_name_leads_nowhere_else() {
        let dir = tempfile::tempdir().unwrap();
        let directory = Directory::open(dir.path()).unwrap();
        for name in ["", ".", "..", "a/b", "../a", "/etc/passwd", "a/"] {
            assert!(error(directory.write(name, b"x")).contains("is not the name of a file"), "{name}");
        }
        assert_eq!(directory.names().unwrap(), [""; 0]);
    }

    #[test]
    fn a_file_is_replaced_as_a_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let directory = Directory::open(dir.path()).unwrap();
        fs::write(dir.path().join("plain"), "").unwrap();
        directory.write("a", b"old").unwrap();
        let mode = |name: &str| fs::metadata(dir.path().join(name)).unwrap().permissions().mode();
        assert_eq!(mode("a"), mode("plain"), "the umask decides who may read it");
        let torn = directory.write_with("a", |beside, mut file| {
            file.write_all(b"ne")?;
            assert_eq!(fs::read(beside)?, b"ne", "it can be written by its path, too");
            Ok(fs::write("/dev/full", "w")?)
        });
        assert!(error(torn).contains("a: cannot be written: No space left on device"));
        assert_eq!(directory.read("a", 3).unwrap().unwrap(), b"old");
        assert!(error(directory.read("a", 2)).contains("a: has more than 2 bytes, the limit"));
        assert_eq!(directory.read("b", 3).unwrap(), None);
        assert_eq!(directory.names().unwrap(), ["a", "plain"], "no temporary file remains");
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
}
