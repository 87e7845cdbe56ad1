//! What a domain prepared for its local simulators, kept in the run directory. A resume need not prepare it again.

use anyhow::Result;

use super::files::PREPARED;
use crate::config::RunConfig;
use dials_core::domain::Domain;
use dials_core::outside::Directory;
use dials_learn::config::Simulator;

/// Largest file, in bytes. What is larger is not kept, and prepared again.
const LARGEST: u64 = 4 << 30;

/// Returns what all workers need to make local simulators: what the directory keeps, or else what the domain prepares now. A file
/// of other networks or settings, or a damaged one, is replaced.
pub fn prepare(domain: &dyn Domain, config: &RunConfig, directory: &Directory) -> Result<Option<Vec<u8>>> {
    if config.learning.simulator == Simulator::Global {
        return Ok(None);
    }
    let kept = directory.read(PREPARED, LARGEST)?;
    let prepared = domain.prepare(kept.as_deref())?;
    if let Some(bytes) = &prepared
        && kept.as_ref() != Some(bytes)
        && bytes.len() as u64 <= LARGEST
    {
        directory.write(PREPARED, bytes)?;
    }
    Ok(prepared)
}
