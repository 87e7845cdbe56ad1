//! Texts that SUMO loads like files, but that nobody else can change, and that leave nothing behind.

use std::fs::File;
use std::io::Write;
use std::os::fd::AsRawFd;
use std::thread::sleep;
use std::time::Duration;

use anyhow::{Context, Result};
use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};
use rustix::io::Errno;

/// Tries to seal a file, and the wait between two of them. The kernel refuses to while it holds a page itself, such as to move it.
const TRIES: usize = 50;
const WAIT: Duration = Duration::from_millis(20);

/// A sealed text: what SUMO loads, now or in a later episode, is what this program wrote. It goes with the process,
/// however that ends, and needs no temporary directory.
pub(crate) struct MemoryFile(File);

impl MemoryFile {
    pub(crate) fn new(text: &str) -> Result<MemoryFile> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let descriptor = memfd_create("network", flags).context("no file in memory for a network of SUMO")?;
        let mut file = File::from(descriptor);
        file.write_all(text.as_bytes()).context("no memory for a network of SUMO")?;
        seal(&file).context("a network of SUMO in memory cannot be sealed")?;
        Ok(MemoryFile(file))
    }

    pub(crate) fn path(&self) -> String {
        format!("/proc/self/fd/{}", self.0.as_raw_fd())
    }
}

fn seal(file: &File) -> rustix::io::Result<()> {
    let all = SealFlags::WRITE | SealFlags::GROW | SealFlags::SHRINK | SealFlags::SEAL;
    for _ in 1..TRIES {
        match fcntl_add_seals(file, all) {
            Err(Errno::BUSY) => sleep(WAIT),
            sealed => return sealed,
        }
    }
    fcntl_add_seals(file, all)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn it_reads_like_a_file_and_cannot_be_written() {
        let file = MemoryFile::new("<net/>").unwrap();
        for _ in 0..2 {
            assert_eq!(fs::read_to_string(file.path()).unwrap(), "<net/>");
        }
        assert!(fs::write(file.path(), "<edgeData/>").is_err());
        assert_eq!(fs::read_to_string(file.path()).unwrap(), "<net/>");
    }
}
