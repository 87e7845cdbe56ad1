//! Which domain a config names: the only place that knows them all.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use crate::config::Config;
use crate::domain::Domain;
use crate::traffic::Traffic;
use crate::warehouse::Warehouse;

/// Opens the domain of a config, with whatever files it needs.
pub fn open(config: &Config) -> Result<Arc<dyn Domain>> {
    match (&config.traffic, &config.warehouse) {
        (Some(traffic), _) => Ok(Arc::new(Traffic::open(traffic, &config.policy)?)),
        (None, Some(warehouse)) => Ok(Arc::new(Warehouse::new(warehouse))),
        (None, None) => unreachable!("a checked config has a domain"),
    }
}

/// Copies the files that the domain of a config needs into `folder`, and returns the config as it stands there, with
/// paths that count from `base`.
pub fn keep_files(config: &Config, folder: &Path, base: &Path) -> Result<Config> {
    let mut kept = config.clone();
    if let Some(traffic) = &mut kept.traffic {
        std::fs::create_dir(folder)?;
        let from = |path: &Path| path.strip_prefix(base).unwrap_or(path).to_owned();
        for network in [&mut traffic.network, &mut traffic.local_network] {
            crate::traffic::net_file::NetworkFiles::of(network).copy_to(folder)?;
            *network = from(&folder.join(network.file_name().unwrap_or_default()));
        }
    }
    Ok(kept)
}
