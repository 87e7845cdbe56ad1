//! Single files that are written completely or not at all, so that a kill or a full disk loses nothing.

use std::fs::{self, File};
use std::path::Path;

use anyhow::{Context, Result};

use crate::outside::Directory;

/// Writes a file beside its place and moves it there. Readers see the old file or the new one, never a part.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_beside(path, |beside| Ok(fs::write(beside, bytes)?))
}

/// Does the same as [`write_atomically`], for a `write` that makes the file itself.
pub fn write_beside(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    // In a temporary folder, under its final name, because TorchScript archives keep the name.
    let parent = folder_of(path);
    let folder = tempfile::Builder::new().prefix(".new-").tempdir_in(parent).with_context(failed)?;
    let beside = folder.path().join(path.file_name().with_context(failed)?);
    let kept = write(&beside).and_then(|()| Ok(File::open(&beside)?.sync_all()?));
    kept.and_then(|()| Ok(fs::rename(&beside, path)?)).with_context(failed)?;
    Directory::open(parent)?.sync()
}

/// Returns the folder that a file is in.
pub fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_full_disk_is_a_clear_error_and_what_was_there_stays() {
        let dir = tempfile::tempdir().unwrap();
        let kept = dir.path().join("policies.safetensors");
        write_atomically(&kept, b"good").unwrap();
        let write_to_a_full_disk = |beside: &Path| {
            fs::write(beside, b"new")?;
            Ok(fs::write("/dev/full", b"er")?)
        };
        let error = format!("{:#}", write_beside(&kept, write_to_a_full_disk).unwrap_err());
        assert!(error.contains("policies.safetensors: cannot be written: No space left on device"), "{error}");
        assert_eq!(fs::read(&kept).unwrap(), b"good");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary file remains");
    }

    #[test]
    fn a_file_that_is_written_leaves_its_neighbours_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        fs::write(path("policies.part"), b"precious").unwrap();
        fs::write(path("plain"), b"").unwrap();
        write_atomically(&path("policies.pt"), b"new").unwrap();
        assert_eq!(fs::read(path("policies.part")).unwrap(), b"precious");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3);
        let mode = |name: &str| fs::metadata(path(name)).unwrap().permissions().mode();
        assert_eq!(mode("policies.pt"), mode("plain"), "the umask decides who may read it");
    }
}
