//! Files that are written completely or not at all, so that a kill, a full disk or a loss of power loses nothing.
//!
//! New files are made in a staged directory beside their places, made durable and renamed. What a kill leaves behind is
//! swept by the next write into the same directory.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use rustix::fs::{Mode, OFlags, fsync, openat, renameat};

use super::{Directory, StagedDirectory};

/// Writes a file. Readers see the old file or the new one, never a part.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    write_whole_with(path, |beside| Ok(fs::write(beside, bytes)?))
}

fn write_whole_with(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let name = path.file_name().with_context(failed)?;
    let folder = Directory::open(folder_of(path)).with_context(failed)?;
    replace(&folder, &[name], |new| write(&new.path_of(name))).with_context(failed)
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
    let write = |new: &Directory| {
        names.iter().zip(files).try_for_each(|(name, (_, content))| Ok(fs::write(new.path_of(name), content)?))
    };
    Directory::open(dir).and_then(|folder| replace(&folder, &names, write)).with_context(unwritable)
}

/// Lets `write` make files of these names in a new directory, and then moves them into `folder`.
pub(super) fn replace(
    folder: &Directory,
    names: &[&OsStr],
    write: impl FnOnce(&Directory) -> Result<()>,
) -> Result<()> {
    let staged = StagedDirectory::make_in(folder)?;
    let new = staged.directory();
    write(new)?;
    for &name in names {
        fsync(openat(new, name, OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::CLOEXEC, Mode::empty())?)?;
    }
    names.iter().try_for_each(|&name| renameat(new, name, folder, name))?;
    drop(staged);
    folder.sync()
}

/// Returns the folder that a file is in.
pub fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn count(dir: &Path) -> usize {
        fs::read_dir(dir).unwrap().count()
    }

    #[test]
    fn a_full_disk_is_a_clear_error_and_what_was_there_stays() {
        let dir = tempfile::tempdir().unwrap();
        let kept = dir.path().join("policies.safetensors");
        write_whole(&kept, b"good").unwrap();
        let write_to_a_full_disk = |beside: &Path| {
            fs::write(beside, b"new")?;
            Ok(fs::write("/dev/full", b"er")?)
        };
        let error = format!("{:#}", write_whole_with(&kept, write_to_a_full_disk).unwrap_err());
        assert!(error.contains("policies.safetensors: cannot be written: No space left on device"), "{error}");
        assert_eq!(fs::read(&kept).unwrap(), b"good");
        assert_eq!(count(dir.path()), 1, "no temporary file remains");
    }

    #[test]
    fn a_file_that_is_written_leaves_its_neighbours_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        fs::write(path("policies.part"), b"precious").unwrap();
        fs::write(path("plain"), b"").unwrap();
        write_whole(&path("policies.pt"), b"new").unwrap();
        assert_eq!(fs::read(path("policies.part")).unwrap(), b"precious");
        assert_eq!(count(dir.path()), 3);
        let mode = |name: &str| fs::metadata(path(name)).unwrap().permissions().mode();
        assert_eq!(mode("policies.pt"), mode("plain"), "the umask decides who may read it");
    }

    #[test]
    fn files_are_written_together_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let blocked = dir.path().join("b");
        fs::create_dir(&blocked).unwrap();
        let files = [(dir.path().join("a"), vec![1]), (blocked.clone(), vec![2])];
        let error = write_together(dir.path(), &files).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: is a directory", blocked.display())), "{error}");
        assert_eq!(count(dir.path()), 1, "only the directory b is there");
        fs::remove_dir(&blocked).unwrap();
        write_together(dir.path(), &files).unwrap();
        assert_eq!((fs::read(dir.path().join("a")).unwrap(), fs::read(&blocked).unwrap()), (vec![1], vec![2]));
    }

    #[test]
    fn what_a_killed_write_left_is_swept_by_the_next_one_and_what_is_being_written_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let [killed, in_use, theirs] = ["a1B2c3", "d4E5f6", "notes"].map(|end| {
            let path = dir.path().join(format!(".dials-traffic-new-{end}"));
            fs::create_dir(&path).unwrap();
            fs::write(path.join("a"), "x").unwrap();
            path
        });
        let _lock = Directory::lock(&in_use).unwrap();
        let ways: [fn(&Path) -> Result<()>; 3] = [
            |path| write_whole(path, b"new"),
            |path| write_together(folder_of(path), &[(path.to_owned(), b"new".to_vec())]),
            |path| Directory::open(folder_of(path))?.write("2", b"new"),
        ];
        for (number, write) in ways.into_iter().enumerate() {
            fs::create_dir_all(&killed).unwrap();
            write(&dir.path().join(number.to_string())).unwrap();
            assert!(!killed.exists(), "nobody holds its lock");
            assert!(in_use.join("a").exists() && theirs.join("a").exists());
        }
        assert_eq!(count(dir.path()), 5);
    }
}
