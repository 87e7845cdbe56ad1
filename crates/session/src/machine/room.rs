//! How much room the machine has left: memory and disks.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use rustix::fs::statvfs;

/// Returns the memory that new processes can have, in MiB. `None` if the system does not say.
pub fn free_memory_mib() -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024)
}

/// Returns the room on the disk of a directory for a user without special rights, in MiB.
pub fn free_disk_mib(dir: &Path) -> Result<u64> {
    let disk = statvfs(dir).with_context(|| format!("{}: cannot be looked at", dir.display()))?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize) >> 20)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_has_memory_and_a_disk_and_no_disk_is_where_nothing_is() {
        assert!(free_memory_mib().unwrap() > 0);
        assert!(free_disk_mib(&std::env::temp_dir()).unwrap() > 0);
        assert!(free_disk_mib(Path::new("/no/such/folder")).unwrap_err().to_string().contains("/no/such/folder"));
    }
}
