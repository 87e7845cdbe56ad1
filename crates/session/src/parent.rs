//! A process that ends together with the one that started it.

use anyhow::{Context, Result, ensure};
use rustix::process::{Signal, getppid, set_parent_process_death_signal};

/// The hidden flag that names the parent process. When the parent ends, this process ends too.
pub const END_WITH: &str = "--end-with";

/// Makes the system kill this process when its parent ends, however the parent ends.
pub fn end_with(parent: u32) -> Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL))
        .context("cannot arrange to end together with the parent process")?;
    // The parent may have ended before the call above.
    let lives = getppid().is_some_and(|pid| pid.as_raw_nonzero().get() as u32 == parent);
    ensure!(lives, "the process that started this one has ended");
    Ok(())
}
