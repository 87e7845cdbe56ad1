//! Which domain a config names: the only place that knows them all.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};

use crate::config::{Config, DomainConfig};
use crate::domain::Domain;
use crate::nn::use_vectors;
use crate::records::files;
use crate::traffic::Traffic;
use crate::traffic::sim::recording::Tape;
use crate::warehouse::Warehouse;

/// Where a machine cannot compute as a config says; only the width that is fixed can be missing.
pub const NO_SUCH_VECTORS: &str = "numerics.vector_width = \"256-bit\": not on this machine; \"widest\" is for all";

/// Opens the domain of a config, with whatever files it needs, and from now on lets the networks of this process compute as
/// the config says: every process that computes with them comes by here first.
pub fn open(config: &Config) -> Result<Arc<dyn Domain>> {
    use_vectors(config.numerics.vector_width).context(NO_SUCH_VECTORS)?;
    find(config)
}

/// Finds the domain of a config, to ask it something; nothing computes with it.
pub fn find(config: &Config) -> Result<Arc<dyn Domain>> {
    Ok(match table(config) {
        DomainConfig::Traffic(table) => Arc::new(Traffic::open(table)?),
        DomainConfig::Warehouse(table) => Arc::new(Warehouse::new(table)),
    })
}

fn table(config: &Config) -> &DomainConfig {
    config.domain.as_ref().expect("a config that was loaded has a domain")
}

/// The traffic domain of a config, if that is its domain, for what no other domain has.
pub fn traffic(config: &Config) -> Result<Option<Traffic>> {
    match table(config) {
        DomainConfig::Traffic(table) => Traffic::open(table).map(Some),
        _ => Ok(None),
    }
}

/// As [`open`], but the first episode that the domain's simulators play goes on `tape`.
pub fn open_recorded(config: &Config, tape: &Tape) -> Result<Traffic> {
    match traffic(config)? {
        Some(traffic) => Ok(traffic.record_on(tape)),
        None => bail!(
            "only traffic is recorded, and this is {}; other domains may draw with --render",
            table(config).name()
        ),
    }
}

/// Tries out what only a simulator can say of the domain's files, so that it is said before a run begins.
pub fn check(config: &Config) -> Result<()> {
    find(config)?.try_out()
}

/// Whether the domain's files could be loaded from a run directory at `path`.
pub fn check_place(config: &Config, path: &Path) -> Result<()> {
    find(config)?.check_place(&path.join(files::NETWORKS))
}

/// Copies the domain's files into the run directory `dir`, and returns the config as it stands there.
pub fn keep_files(config: &Config, domain: &dyn Domain, dir: &Path) -> Result<Config> {
    let places = domain.keep_files(&dir.join(files::NETWORKS))?;
    let mut kept = config.clone();
    let paths = kept.domain.iter_mut().flat_map(DomainConfig::paths);
    paths.zip(places).for_each(|((_, path), place)| *path = Path::new(files::NETWORKS).join(place));
    Ok(kept)
}
