//! CSV files that grow by whole blocks of lines, one write per block, and are cut back to the length at a checkpoint.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};

/// Appends lines to a CSV file in one write; a new file begins with the header. If that fails, the file is as before.
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

/// Appends what `block` makes to a file in one write; `block` gets whether the file is new. If that fails, the file is
/// as before.
pub fn append_block(path: &Path, block: impl FnOnce(bool) -> Result<Vec<u8>>) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let mut file = OpenOptions::new().append(true).create(true).open(path).with_context(failed)?;
    let before = file.metadata().with_context(failed)?.len();
    let block = block(before == 0)?;
    file.write_all(&block).inspect_err(|_| drop(file.set_len(before))).with_context(failed)
}

/// Cuts a growing file to an earlier length.
pub fn cut(path: &Path, length: u64) -> Result<()> {
    let failed = || format!("{}: cannot be cut to its length at the checkpoint", path.display());
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
        "{}: has {now} bytes, but had {length} when the newest checkpoint was written: it was changed after that",
        path.display()
    );
    file.set_len(length).with_context(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn line(text: &str) -> Vec<String> {
        vec![text.to_owned()]
    }

    #[test]
    fn a_full_disk_is_a_clear_error() {
        let dir = tempfile::tempdir().unwrap();
        // The kernel's own full disk.
        let full = dir.path().join("returns.csv");
        symlink("/dev/full", &full).unwrap();
        let error = format!("{:#}", append(&full, &line("a"), &[line("1")]).unwrap_err());
        assert!(error.contains("returns.csv: cannot be written: No space left on device"), "{error}");
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
        assert!(cut(&path, length + 1).unwrap_err().to_string().contains("it was changed after that"));
        cut(&path, 0).unwrap();
        assert!(!path.exists());
        cut(&path, 0).unwrap();
    }
}
