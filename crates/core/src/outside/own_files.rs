//! The files of an opened directory: regular files with one name, never reached by a path or through a link.

use std::fs::File;
use std::io::Write;
use std::path::{Component, Path};

use anyhow::{Context, Error, Result, anyhow, bail};
use rustix::fs::{AtFlags, FileType, Mode, OFlags, Stat, fstat, openat, renameat, statat, unlinkat};
use rustix::io::Errno;

use super::Directory;
use super::file::read_limited;
use super::whole::replace;

impl Directory {
    /// Checks that nothing but a regular file with one name stands at `name`, if anything does.
    pub fn check(&self, name: &str) -> Result<()> {
        match statat(self, single(name)?, AtFlags::SYMLINK_NOFOLLOW) {
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
        let failed = || format!("{}: cannot be read", self.path_of(name).display());
        read_limited(&file, at_most).map(Some).with_context(failed)
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

    /// Writes a file into a directory that nobody reads yet. Only [`Directory::sync_tree`] makes it durable.
    pub fn put(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let failed = || format!("{}: cannot be written", self.path_of(name).display());
        self.open_anew(name)?.write_all(bytes).with_context(failed)
    }

    /// Replaces a file. Readers see the old file or the new one, never a part, also after a loss of power.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.write_with(name, |beside| Ok(std::fs::write(beside, bytes)?))
    }

    /// Does the same as [`Directory::write`], for a `write` that makes the file itself. It gets a path of the same name
    /// in another directory.
    pub fn write_with(&self, name: &str, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
        self.check(name)?;
        // By the open directory, because this one may have been moved.
        let by_path = |new: &Directory| write(&new.reached_while_open().join(name));
        replace(self, &[name.as_ref()], by_path).map_err(|error| self.failed(error, name, "cannot be written"))
    }

    /// Moves a complete file of this directory to another name in it, and replaces what had that name.
    pub fn complete(&self, from: &str, to: &str) -> Result<()> {
        self.check(to)?;
        let file = self.open_file(from)?;
        let moved = file
            .map_or(Ok(()), |file| file.sync_all().map_err(Error::from))
            .and_then(|()| Ok(renameat(self, single(from)?, self, to)?));
        moved.map_err(|error| self.failed(error, to, "cannot be written"))?;
        self.sync()
    }

    /// Removes a file or a link, never what a link leads to. If there is none, nothing happens.
    pub fn remove(&self, name: &str) -> Result<()> {
        match unlinkat(self, single(name)?, AtFlags::empty()) {
            Ok(()) | Err(Errno::NOENT) => Ok(()),
            Err(error) => Err(self.failed(error.into(), name, "cannot be removed")),
        }
    }

    fn open_own(&self, name: &str, how: OFlags) -> Result<File> {
        self.check(name)?;
        // Opening a pipe waits for its other end, but for this flag.
        let flags = how | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file = match openat(self, single(name)?, flags, Mode::from(0o666)) {
            Ok(file) => File::from(file),
            Err(error) => {
                self.check(name)?; // It was replaced in between.
                return Err(self.failed(error.into(), name, "cannot be opened"));
            }
        };
        check_own(&fstat(&file)?, &self.path_of(name))?;
        Ok(file)
    }
}

/// Returns a name that leads nowhere but to an entry of a directory itself.
pub(super) fn single(name: &str) -> Result<&str> {
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

    use rustix::fs::{CWD, mknodat};

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

    #[test]
    fn a_complete_file_takes_its_place_but_not_that_of_a_link() {
        let dir = tempfile::tempdir().unwrap();
        let (directory, outside) = (Directory::open(dir.path()).unwrap(), tempfile::NamedTempFile::new().unwrap());
        directory.put("a.part", b"new").unwrap();
        directory.put("a.json", b"old").unwrap();
        symlink(outside.path(), dir.path().join("link")).unwrap();
        assert!(error(directory.complete("a.part", "link")).contains("link: is a link"));
        directory.complete("a.part", "a.json").unwrap();
        assert_eq!(directory.names().unwrap(), ["a.json", "link"]);
        assert_eq!(directory.read("a.json", 3).unwrap().unwrap(), b"new");
        assert!(error(directory.complete("a.part", "a.json")).contains("a.json: cannot be written: No such file"));
    }
}
