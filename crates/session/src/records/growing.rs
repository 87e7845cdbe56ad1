//! Files that only grow: their length, and the checksum of everything in them, so that a later change is noticed.

use std::io::Write;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use dials_core::outside::Directory;
use dials_learn::evaluation::csv::Lines;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    pub(crate) bytes: u64,
    /// CRC-32C of all these bytes.
    pub(crate) crc32c: u32,
}

impl Mark {
    fn after(self, block: &[u8]) -> Mark {
        Mark { bytes: self.bytes + block.len() as u64, crc32c: crc32c::crc32c_append(self.crc32c, block) }
    }
}

/// A file that grows by whole blocks, one write per block. Nobody else writes it.
#[derive(Clone, Debug)]
pub struct GrowingFile {
    name: String,
    mark: Mark,
    /// Whether something was written that a loss of power could still take away.
    unsynced: bool,
}

impl GrowingFile {
    /// Describes a file that has grown up to `mark`. Without a byte it does not exist.
    pub fn new(name: &str, mark: Mark) -> GrowingFile {
        GrowingFile { name: name.to_owned(), mark, unsynced: false }
    }

    pub(crate) fn mark(&self) -> Mark {
        self.mark
    }

    /// Appends what `block` makes; it gets whether the file is new. If that fails, the file is as before.
    pub(crate) fn append(&mut self, directory: &Directory, block: impl FnOnce(bool) -> Result<Vec<u8>>) -> Result<()> {
        let new = self.mark.bytes == 0;
        let block = block(new)?;
        let mut file = if new { directory.open_to_append(&self.name)? } else { directory.open_to_go_on(&self.name)? };
        let failed = || format!("{}: cannot be written", directory.path_of(&self.name).display());
        let (length, expected) = (file.metadata().with_context(failed)?.len(), self.mark.bytes);
        ensure!(
            length == expected,
            "{}: has {length} bytes instead of {expected}: something else changed it meanwhile",
            directory.path_of(&self.name).display()
        );
        let written = file.write_all(&block).inspect_err(|_| drop(file.set_len(expected)));
        written.with_context(failed)?;
        self.mark = self.mark.after(&block);
        self.unsynced = true;
        Ok(())
    }

    /// Appends lines of a CSV file, after its header if the file is new.
    pub fn append_lines(&mut self, directory: &Directory, Lines { header, lines }: &Lines) -> Result<()> {
        self.append(directory, |new| {
            let mut writer = csv::Writer::from_writer(Vec::new());
            new.then_some(header).into_iter().chain(lines).try_for_each(|line| writer.write_record(line))?;
            writer.into_inner().context("a CSV block in memory")
        })
    }

    /// Makes everything that was appended durable. The caller makes new names durable.
    pub(crate) fn sync(&mut self, directory: &Directory) -> Result<()> {
        if self.unsynced {
            let failed = || format!("{}: cannot be written", directory.path_of(&self.name).display());
            directory.open_to_go_on(&self.name)?.sync_data().with_context(failed)?;
            self.unsynced = false;
        }
        Ok(())
    }

    /// Cuts off what was appended after the mark. The caller has checked that the file [fits](misfit).
    pub(crate) fn cut(&self, directory: &Directory) -> Result<()> {
        if self.mark.bytes == 0 {
            directory.check(&self.name)?;
            return directory.remove(&self.name);
        }
        let failed = || {
            let path = directory.path_of(&self.name);
            format!("{}: cannot be cut to its length at the checkpoint", path.display())
        };
        directory.open_to_go_on(&self.name)?.set_len(self.mark.bytes).with_context(failed)
    }
}

/// Says how a file differs from what it held at `mark`. `None`: it holds the same, and maybe more after it.
pub(crate) fn misfit(directory: &Directory, name: &str, mark: Mark) -> Result<Option<String>> {
    let Some(bytes) = directory.read(name, u64::MAX)? else {
        return Ok((mark.bytes > 0).then(|| "is missing".to_owned()));
    };
    Ok(match bytes.get(..mark.bytes as usize) {
        None => Some(format!("lost {} bytes", mark.bytes - bytes.len() as u64)),
        Some(then) => (Mark::default().after(then) != mark).then(|| "was changed".to_owned()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_growing_file_is_cut_to_where_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let directory = Directory::open(dir.path()).unwrap();
        let path = dir.path().join("a.csv");
        let text = || fs::read_to_string(&path).unwrap();
        let row = |line: &[&str]| line.iter().map(|&field| field.to_owned()).collect::<Vec<_>>();
        let of = |lines: &[&str]| Lines {
            header: row(&["x", "b,c"]),
            lines: lines.iter().map(|line| row(&[line, ""])).collect(),
        };
        let mut file = GrowingFile::new("a.csv", Mark::default());
        file.append_lines(&directory, &of(&["1", "2"])).unwrap();
        let mark = file.mark();
        // The check value of CRC-32C is of the nine digits.
        assert_eq!(Mark::default().after(b"1234").after(b"56789"), Mark { bytes: 9, crc32c: 0xe306_9283 });
        file.append_lines(&directory, &of(&["3"])).unwrap();
        file.sync(&directory).unwrap();
        assert_eq!(text(), "x,\"b,c\"\n1,\n2,\n3,\n");
        let mut file = GrowingFile::new("a.csv", mark);
        assert_eq!(misfit(&directory, "a.csv", mark).unwrap(), None);
        file.cut(&directory).unwrap();
        assert_eq!(text(), "x,\"b,c\"\n1,\n2,\n");
        fs::write(&path, text() + "9").unwrap();
        let error = file.append_lines(&directory, &of(&["3"])).unwrap_err().to_string();
        assert!(error.contains("a.csv: has 15 bytes instead of 14: something else changed it"), "{error}");
        for _ in 0..2 {
            GrowingFile::new("a.csv", Mark::default()).cut(&directory).unwrap();
            assert!(!path.exists());
        }
    }
}
