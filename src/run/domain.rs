//! Which domain a config names: the only place that knows them all.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};

use crate::config::Config;
use crate::domain::Domain;
use crate::nn::use_vectors;
use crate::records::files;
use crate::traffic::Traffic;
use crate::traffic::net_file::{NetworkFiles, read_shape};
use crate::traffic::recording::Tape;
use crate::warehouse::Warehouse;

/// The networks of a run directory have the same names in all of them.
const NETWORKS: [&str; 2] = ["global", "local"];

/// Where a machine cannot compute as a config says; only the width that is fixed can be missing.
pub const NO_SUCH_VECTORS: &str = "numerics.vector_width = \"256-bit\": not on this machine; \"widest\" is for all";

/// Opens the domain of a config, with whatever files it needs, and from now on lets the networks of this process compute as
/// the config says: every process that computes with them comes by here first.
pub fn open(config: &Config) -> Result<Arc<dyn Domain>> {
    use_vectors(config.numerics.vector_width).context(NO_SUCH_VECTORS)?;
    match (&config.traffic, &config.warehouse) {
        (Some(traffic), _) => Ok(Arc::new(Traffic::open(traffic, &config.policy)?)),
        (None, Some(warehouse)) => Ok(Arc::new(Warehouse::new(warehouse))),
        (None, None) => unreachable!("a checked config has a domain"),
    }
}

/// Rows and columns of a config's agents.
pub fn grid_shape(config: &Config) -> Result<(usize, usize)> {
    match (&config.traffic, &config.warehouse) {
        (Some(traffic), _) => {
            let grid = read_shape(&NetworkFiles::of(&traffic.network).net)?;
            Ok((grid.rows(), grid.cols()))
        }
        (None, Some(warehouse)) => Ok((warehouse.agents_per_side, warehouse.agents_per_side)),
        (None, None) => unreachable!("a checked config has a domain"),
    }
}

/// How many agents a config has.
pub fn agents(config: &Config) -> Result<usize> {
    grid_shape(config).map(|(rows, columns)| rows * columns)
}

/// As [`open`], but the first episode that the domain's simulators play goes on `tape`.
pub fn open_recorded(config: &Config, tape: &Tape) -> Result<Traffic> {
    let traffic = config.traffic.as_ref().context("only traffic is recorded; the warehouse draws with --render")?;
    Ok(Traffic::open(traffic, &config.policy)?.record_on(tape))
}

/// The traffic domain of a config, if that is its domain, for what no other domain has.
pub fn traffic(config: &Config) -> Result<Option<Traffic>> {
    config.traffic.as_ref().map(|traffic| Traffic::open(traffic, &config.policy)).transpose()
}

/// Tries out what only a simulator can say of the domain's files, so that it is said before a run begins.
pub fn check(config: &Config) -> Result<()> {
    match &config.traffic {
        Some(traffic) => Traffic::open(traffic, &config.policy)?.check_in_sumo(),
        None => Ok(()),
    }
}

/// Whether the domain's files could be loaded from a run directory at `path`.
pub fn check_place(config: &Config, path: &Path) -> Result<()> {
    if config.traffic.is_some() {
        for name in NETWORKS {
            NetworkFiles::of(&path.join(files::NETWORKS).join(name)).check_paths()?;
        }
    }
    Ok(())
}

/// Copies the domain's files into the run directory `dir`, and returns the config as it stands there.
pub fn keep_files(config: &Config, dir: &Path) -> Result<Config> {
    let mut kept = config.clone();
    if let Some(traffic) = &mut kept.traffic {
        let folder = dir.join(files::NETWORKS);
        std::fs::create_dir(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        for (network, name) in [&mut traffic.network, &mut traffic.local_network].into_iter().zip(NETWORKS) {
            NetworkFiles::of(network).copy_to(&folder, name)?;
            *network = Path::new(files::NETWORKS).join(name);
        }
    }
    Ok(kept)
}
