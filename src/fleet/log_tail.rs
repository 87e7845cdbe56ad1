//! The end of a worker's log, for the message about its death.

use std::fs::File;
use std::io::{Read, Result, Seek, SeekFrom};
use std::path::Path;

/// Number of lines that a message shows.
const LINES: usize = 8;
/// Number of bytes that are read for them. A log may have gigabytes.
const BYTES: u64 = 16 << 10;

/// Returns the last lines of a log with its path. A log that cannot be read has none.
pub fn log_tail(log: &Path) -> String {
    let bytes = last_bytes(log).unwrap_or_default();
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<&str> = text.lines().collect();
    let last = &lines[lines.len().saturating_sub(LINES)..];
    format!("last lines of {}:\n    {}", log.display(), last.join("\n    "))
}

fn last_bytes(log: &Path) -> Result<Vec<u8>> {
    let mut file = File::open(log)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(BYTES)))?;
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

    #[test]
    fn the_last_lines_of_a_log_of_a_terabyte_are_shown() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("worker_0.log");
        // A sparse file, which takes no disk space. Reading all of it would take all memory.
        File::create(&log).unwrap().set_len(1 << 40).unwrap();
        let lines: String = (0..10).map(|line| format!("\nline {line}")).collect();
        OpenOptions::new().append(true).open(&log).unwrap().write_all(lines.as_bytes()).unwrap();
        let tail = log_tail(&log);
        assert!(tail.starts_with(&format!("last lines of {}:\n    line 2\n    line 3\n", log.display())), "{tail}");
        assert!(tail.ends_with("line 8\n    line 9"), "{tail}");
    }

    #[test]
    fn a_short_log_is_shown_whole_and_a_missing_one_is_empty() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("worker_0.log");
        assert_eq!(log_tail(&log), format!("last lines of {}:\n    ", log.display()));
        std::fs::write(&log, "one\ntwo\n").unwrap();
        assert_eq!(log_tail(&log), format!("last lines of {}:\n    one\n    two", log.display()));
    }
}
