//! The files of a run directory: their names, and how they are written so that a kill or a full disk loses nothing.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};

pub const CONFIG: &str = "config.toml";
pub const NETWORKS: &str = "networks";
pub const RUN: &str = "run.json";
pub const RETURNS: &str = "returns.csv";
pub const EPISODES: &str = "episodes.csv";
pub const TRAINING: &str = "training.csv";
pub const AIP_LOSS: &str = "aip_loss.csv";
pub const AIP_DRIFT: &str = "aip_drift.csv";
pub const TIMING: &str = "timing.csv";
pub const MEMORY: &str = "memory.csv";
/// For TensorBoard, which looks for this word in a name.
pub const EVENTS: &str = "events.out.tfevents";
pub const POLICIES: &str = "policies.safetensors";
pub const AIPS: &str = "aips.safetensors";
pub const CHECKPOINTS: &str = "checkpoints";

/// The files that grow as the run goes.
pub const GROWING: [&str; 8] = [RETURNS, EPISODES, TRAINING, AIP_LOSS, AIP_DRIFT, TIMING, MEMORY, EVENTS];

/// Makes sure that one process at a time writes a run; the system lifts the lock when the process ends, however.
pub fn lock(dir: &Path) -> Result<File> {
    let folder = File::open(dir).with_context(|| format!("{}: cannot be opened", dir.display()))?;
    folder.try_lock().with_context(|| format!("{}: another process is writing this run", dir.display()))?;
    Ok(folder)
}

/// Cuts a growing file to a length that it had before.
pub fn cut(path: &Path, length: u64) -> Result<()> {
    let failed = || format!("{}: cannot be cut to where its checkpoint left it", path.display());
    if length == 0 {
        return match fs::remove_file(path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error).with_context(failed),
            _ => Ok(()),
        };
    }
    let file = OpenOptions::new().write(true).open(path).with_context(failed)?;
    let now = file.metadata().with_context(failed)?.len();
    ensure!(
        now >= length,
        "{}: has {now} bytes, but had {length} when the newest checkpoint was written: it was changed since",
        path.display()
    );
    file.set_len(length).with_context(failed)
}

/// Appends lines to a CSV file in one write; a new file begins with the header. Where that fails the file is as before.
pub fn append(path: &Path, header: &[String], lines: &[Vec<String>]) -> Result<()> {
    append_block(path, |new| {
        let mut writer = csv::Writer::from_writer(Vec::new());
        if new {
            writer.write_record(header)?;
        }
        lines.iter().try_for_each(|line| writer.write_record(line))?;
        writer.into_inner().context("a CSV block in memory")
    })
}

/// Appends what `block` makes to a file in one write; `block` is told whether the file is new. Where that fails the file
/// is as before.
pub fn append_block(path: &Path, block: impl FnOnce(bool) -> Result<Vec<u8>>) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let mut file = OpenOptions::new().append(true).create(true).open(path).with_context(failed)?;
    let before = file.metadata().with_context(failed)?.len();
    let block = block(before == 0)?;
    file.write_all(&block).inspect_err(|_| drop(file.set_len(before))).with_context(failed)
}

/// Writes a file beside its place and moves it there: readers see the old one or the new one, whole.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_beside(path, |beside| Ok(fs::write(beside, bytes)?))
}

/// As [`write_atomically`], for a `write` that makes the file itself.
pub fn write_beside(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    // In a folder of its own, where it has its own name: TorchScript's archives keep that.
    let folder = tempfile::Builder::new().prefix(".new-").tempdir_in(folder_of(path)).with_context(failed)?;
    let beside = folder.path().join(path.file_name().with_context(failed)?);
    let kept = write(&beside).and_then(|()| Ok(File::open(&beside)?.sync_all()?));
    kept.and_then(|()| Ok(fs::rename(&beside, path)?)).with_context(failed)
}

/// The folder that a file is in.
pub fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt, symlink};

    fn line(text: &str) -> Vec<String> {
        vec![text.to_owned()]
    }

    #[test]
    fn a_full_disk_is_a_clear_error_and_what_was_there_stays() {
        let dir = tempfile::tempdir().unwrap();
        // The kernel's own full disk.
        let full = dir.path().join("returns.csv");
        symlink("/dev/full", &full).unwrap();
        let error = format!("{:#}", append(&full, &line("a"), &[line("1")]).unwrap_err());
        assert!(error.contains("returns.csv: cannot be written: No space left on device"), "{error}");

        let kept = dir.path().join("policies.safetensors");
        write_atomically(&kept, b"good").unwrap();
        let write_to_a_full_disk = |beside: &Path| {
            fs::write(beside, b"new")?;
            Ok(fs::write("/dev/full", b"er")?)
        };
        let error = format!("{:#}", write_beside(&kept, write_to_a_full_disk).unwrap_err());
        assert!(error.contains("policies.safetensors: cannot be written: No space left on device"), "{error}");
        assert_eq!(fs::read(&kept).unwrap(), b"good");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2, "nothing is left behind");
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
        assert_eq!(mode("policies.pt"), mode("plain"), "and is for everyone whom the umask allows");
    }

    #[test]
    fn a_growing_file_is_cut_to_where_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csv");
        append(&path, &line("header"), &[line("1"), line("2")]).unwrap();
        let length = fs::metadata(&path).unwrap().len();
        append(&path, &line("header"), &[line("3")]).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "header\n1\n2\n3\n");
        cut(&path, length).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "header\n1\n2\n");
        assert!(cut(&path, length + 1).unwrap_err().to_string().contains("it was changed since"));
        cut(&path, 0).unwrap();
        assert!(!path.exists());
        cut(&path, 0).unwrap();
    }
}
