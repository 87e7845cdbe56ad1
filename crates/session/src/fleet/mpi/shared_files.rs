//! The config and the networks of a run that rank 0 sends to the relays, which need no shared file system.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::watch::Address;
use crate::config::RunConfig;
use dials_core::outside::Directory;

/// Longest file that is sent. A network of 10 000 intersections has under 1 GiB.
const LONGEST: u64 = 8 << 30;

#[derive(Serialize, Deserialize)]
pub(super) struct SharedFiles {
    /// Config whose paths lead from the folder in which the files are written.
    pub(crate) config_json: String,
    files: Vec<SharedFile>,
    pub(crate) rank_0: Address,
}

#[derive(Serialize, Deserialize)]
struct SharedFile {
    folder: String,
    name: String,
    bytes: Vec<u8>,
}

/// Returns a config whose paths lead from the run directory and no longer from elsewhere.
pub(super) fn from_the_run_directory(config: &RunConfig, directory: &Directory) -> Result<RunConfig> {
    let mut config = config.clone();
    for (key, path) in config.domain.iter_mut().flat_map(|domain| domain.table_mut().paths()) {
        let within = path.strip_prefix(directory.path());
        *path = within.with_context(|| format!("{key}: {}: is not in the run directory", path.display()))?.to_owned();
    }
    Ok(config)
}

impl SharedFiles {
    /// Reads the files for a config as [`from_the_run_directory`] makes it, those of one folder of the run directory.
    pub(super) fn read(
        config: &RunConfig,
        directory: &Directory,
        folder: &str,
        rank_0: Address,
    ) -> Result<SharedFiles> {
        let mut files = Vec::new();
        if let Some(inside) = directory.subdirectory(folder)? {
            for name in inside.names()? {
                let name = name.into_string().ok().context("a file of the run directory has no name in UTF-8")?;
                let bytes = inside.read(&name, LONGEST)?.with_context(|| format!("{name}: was removed"))?;
                files.push(SharedFile { folder: folder.to_owned(), name, bytes });
            }
        }
        Ok(SharedFiles { config_json: serde_json::to_string(config)?, files, rank_0 })
    }

    pub(super) fn write(&self, place: &Path) -> Result<()> {
        for SharedFile { folder, name, bytes } in &self.files {
            let folder = place.join(folder);
            let path = folder.join(name);
            let written = fs::create_dir_all(&folder).and_then(|()| fs::write(&path, bytes));
            written.with_context(|| format!("{}: cannot be written", path.display()))?;
        }
        Ok(())
    }
}
