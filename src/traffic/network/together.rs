//! Several files of one directory, written all together or not at all.

use std::fs::{self, Permissions};
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use tempfile::NamedTempFile;

/// Writes files into one directory, all of them or none: each is written under another name first, then renamed.
pub fn write_together(dir: &Path, files: &[(PathBuf, Vec<u8>)]) -> Result<()> {
    let unwritable =
        || format!("{}: could not be written to; make it writable or choose another directory", dir.display());
    fs::create_dir_all(dir).with_context(unwritable)?;
    let mut staged = Vec::new();
    for (path, content) in files {
        ensure!(!path.is_dir(), "{}: is a directory, but a file must be written there; move it away", path.display());
        // A temporary file is readable by its owner only, by default; these get the permissions that the umask allows.
        let mut temporary = tempfile::Builder::new();
        let temporary = temporary.prefix(".writing-").permissions(Permissions::from_mode(0o666));
        let mut file = temporary.tempfile_in(dir).with_context(unwritable)?;
        file.write_all(content).with_context(unwritable)?;
        staged.push((file, path));
    }
    staged.into_iter().try_for_each(|(file, path)| rename(file, path))
}

fn rename(file: NamedTempFile, path: &Path) -> Result<()> {
    file.persist(path)
        .map_err(|error| error.error)
        .with_context(|| format!("{}: could not be replaced", path.display()))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_written_together_or_not_at_all() {
        let room = tempfile::tempdir().expect("a temporary directory");
        let blocked = room.path().join("b");
        fs::create_dir(&blocked).expect("a writable directory");
        let files = [(room.path().join("a"), vec![1]), (blocked.clone(), vec![2])];
        let error = write_together(room.path(), &files).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: is a directory", blocked.display())), "{error}");
        assert_eq!(fs::read_dir(room.path()).expect("readable").count(), 1, "only the directory b is there");
    }
}
