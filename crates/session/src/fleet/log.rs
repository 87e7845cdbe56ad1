//! The log of a worker, and its end for the message about its death.

use std::fs::File;
use std::io::{Read, Result, Seek, SeekFrom};

use anyhow::Context;

use dials_core::outside::Directory;

const LINES: usize = 8;
/// Number of bytes that are read for them. A log may have gigabytes.
const BYTES: u64 = 16 << 10;

#[derive(Debug)]
pub struct Log {
    path: String,
    file: File,
    /// Length when it was opened. What stands before is of other processes.
    begin: u64,
}

impl Log {
    /// Opens a log to append to. A link to a file elsewhere is an error.
    pub fn open(folder: &Directory, name: String) -> anyhow::Result<Log> {
        let (file, path) = (folder.open_to_append(&name)?, folder.path_of(name).display().to_string());
        let begin = file.metadata().with_context(|| format!("{path}: cannot be read"))?.len();
        Ok(Log { path, file, begin })
    }

    pub fn file(&self) -> anyhow::Result<File> {
        self.file.try_clone().with_context(|| format!("{}: cannot be written", self.path))
    }

    /// Returns the last lines since it was opened, with the path. If they cannot be read, there are none.
    pub fn tail(&self) -> String {
        let bytes = last_bytes(&self.file, self.begin).unwrap_or_default();
        let text = String::from_utf8_lossy(&bytes);
        let lines: Vec<&str> = text.lines().collect();
        let last = &lines[lines.len().saturating_sub(LINES)..];
        format!("last lines of {}:\n    {}", self.path, last.join("\n    "))
    }
}

fn last_bytes(mut file: &File, begin: u64) -> Result<Vec<u8>> {
    let length = file.metadata()?.len();
    // The worker shares this place in the file, but it only appends.
    file.seek(SeekFrom::Start(length.saturating_sub(BYTES).max(begin)))?;
    let mut bytes = Vec::new();
    // No further than its length at that time, because the worker may still be writing.
    file.take(BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::OpenOptions;
    use std::io::Write;

    fn log(dir: &tempfile::TempDir) -> Log {
        Log::open(&Directory::open(dir.path()).unwrap(), "worker_0.log".to_owned()).unwrap()
    }

    #[test]
    fn the_last_lines_of_a_log_of_a_terabyte_are_shown() {
        let dir = tempfile::tempdir().unwrap();
        let (log, path) = (log(&dir), dir.path().join("worker_0.log"));
        // A sparse file, which takes no disk space. Reading all of it would take all memory.
        log.file().unwrap().set_len(1 << 40).unwrap();
        let lines: String = (0..10).map(|line| format!("\nline {line}")).collect();
        OpenOptions::new().append(true).open(&path).unwrap().write_all(lines.as_bytes()).unwrap();
        let tail = log.tail();
        assert!(tail.starts_with(&format!("last lines of {}:\n    line 2\n    line 3\n", path.display())), "{tail}");
        assert!(tail.ends_with("line 8\n    line 9"), "{tail}");
    }

    #[test]
    fn a_short_log_is_shown_whole_without_lines_of_an_earlier_process() {
        let dir = tempfile::tempdir().unwrap();
        let earlier = log(&dir);
        let path = dir.path().join("worker_0.log");
        assert_eq!(earlier.tail(), format!("last lines of {}:\n    ", path.display()));
        earlier.file().unwrap().write_all(b"std::bad_alloc\n").unwrap();
        let log = log(&dir);
        log.file().unwrap().write_all(b"one\n").unwrap();
        log.tail();
        log.file().unwrap().write_all(b"two\n").unwrap();
        assert_eq!(log.tail(), format!("last lines of {}:\n    one\n    two", path.display()));
    }
}
