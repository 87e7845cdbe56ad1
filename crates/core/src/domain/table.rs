//! The table of a config that says which domain is simulated, and how.

use std::path::PathBuf;
use std::sync::Arc;

use super::{Domain, Result};

/// What the table of every domain must provide, besides being read and written with serde.
pub trait DomainTable {
    /// Returns the number of steps of an episode.
    fn horizon(&self) -> usize;

    /// Returns the number of steps of an episode of the local simulators.
    fn local_horizon(&self) -> usize {
        self.horizon()
    }

    /// Returns whether observations are sets, which only some policies can read: see [`RegionSpec::sets`](super::RegionSpec).
    fn shows_sets(&self) -> bool {
        false
    }

    /// Returns an error that names the key if a value makes no sense. The limits of a horizon are checked elsewhere, for
    /// all domains.
    fn check(&self) -> Result<()>;

    /// Returns the keys that name files, with their values.
    fn paths(&mut self) -> Vec<(&'static str, &mut PathBuf)> {
        Vec::new()
    }

    /// Returns the keys that only local simulators read. On the GS they change nothing.
    fn local_keys(&self) -> &'static [&'static str] {
        &[]
    }

    /// Returns the defaults of keys outside of this table, as the text of a config, if they are not those of all configs.
    fn defaults(&self) -> &'static str {
        ""
    }

    /// Reads the values that the table leaves out from the domain's files.
    fn complete(&mut self) -> Result<()> {
        Ok(())
    }

    /// Opens the domain and reads the files that it needs.
    fn open(&self) -> Result<Arc<dyn Domain>>;
}
