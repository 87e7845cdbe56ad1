//! Finds the domain that a config names. Only this file knows all domains.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};

use super::trial;
use crate::records::files;
use crate::terminal::tell;
use dials_config::{Config, DomainConfig, Simulator};
use dials_core::base::for_terminal;
use dials_core::domain::Domain;
use dials_traffic::Traffic;
use dials_traffic::sim::recording::Tape;
use dials_warehouse::Warehouse;
use stacknets::use_vectors;

/// Error if a machine cannot compute as a config says. Only the fixed width can be missing.
pub const NO_SUCH_VECTORS: &str =
    "numerics.vector_width = \"256-bit\": this machine has no such vector instructions; \"widest\" works everywhere";

/// Opens the domain of a config and reads the files that it needs. Another process tries the files first.
///
/// Also sets the vector width of this process's networks as the config says. So every process must call this before it
/// computes with networks.
pub fn open(config: &Config) -> Result<Arc<dyn Domain>> {
    let domain = open_tried(config)?;
    trial::survive(config, &*domain)?;
    Ok(domain)
}

/// Opens the domain of a config, like [`open`], but tries nothing first: in a process that may end with it, or after
/// the same files were tried elsewhere.
pub fn open_tried(config: &Config) -> Result<Arc<dyn Domain>> {
    use_vectors(config.numerics.vector_width).context(NO_SUCH_VECTORS)?;
    find(config)
}

/// Opens the domain of a config only to ask it something. Leaves the vector width as it is.
pub fn find(config: &Config) -> Result<Arc<dyn Domain>> {
    Ok(match table(config) {
        DomainConfig::Traffic(table) => Arc::new(Traffic::open(table)?),
        DomainConfig::Scenario(table) => Arc::new(Traffic::open_scenario(table)?),
        DomainConfig::Warehouse(table) => Arc::new(Warehouse::new(table)),
    })
}

fn table(config: &Config) -> &DomainConfig {
    config.domain.as_ref().expect("a config that was loaded has a domain")
}

/// Returns the version of SUMO if the domain of a config needs it. If it does not, or SUMO cannot be loaded: `None`.
pub fn sumo_version(config: &Config) -> Option<String> {
    match table(config) {
        DomainConfig::Traffic(_) | DomainConfig::Scenario(_) => dials_traffic::sumo_version().ok(),
        DomainConfig::Warehouse(_) => None,
    }
}

/// Returns the traffic domain of a config, or `None` if the config names another domain.
pub fn traffic(config: &Config) -> Result<Option<Traffic>> {
    match table(config) {
        DomainConfig::Traffic(table) => Traffic::open(table).map(Some),
        DomainConfig::Scenario(table) => Traffic::open_scenario(table).map(Some),
        DomainConfig::Warehouse(_) => Ok(None),
    }
}

/// Returns the traffic domain of a config, like [`traffic`], in which all cars dawdle as much as `sigma` says. Only a
/// scenario has cars that may.
pub fn dawdling(config: &Config, sigma: f64) -> Result<Option<Traffic>> {
    match table(config) {
        DomainConfig::Scenario(table) => Traffic::open_dawdling(table, sigma).map(Some),
        DomainConfig::Traffic(_) if sigma != 0.0 => {
            bail!("--sigma {sigma}: the cars of the paper's grids never dawdle; leave the option out")
        }
        _ => traffic(config),
    }
}

/// Opens the traffic domain of a config. The first episode that its simulators play is recorded on `tape`.
pub fn open_recorded(config: &Config, tape: &Tape) -> Result<Traffic> {
    match traffic(config)? {
        Some(traffic) => {
            trial::survive(config, &traffic)?;
            Ok(traffic.record_on(tape))
        }
        None => {
            let name = table(config).name();
            bail!("only traffic can be recorded, and this is {name}; draw its episodes with `evaluate --render DIR`")
        }
    }
}

/// Tries the domain's files in its simulator, so that errors in them are reported before a run begins. The same for
/// the name of a controller to imitate. Returns the domain. Leaves the vector width as it is.
pub fn check(config: &Config) -> Result<Arc<dyn Domain>> {
    let domain = find(config)?;
    if let Some(name) = &config.policy.imitate {
        domain.check_baseline(name).context("policy.imitate: not a controller of this domain")?;
    }
    ensure!(
        !config.shares_policies() || domain.kinds().count() == 1,
        "gs.shared_policy = true: the agents of this domain are of {} kinds, and only agents of one kind can share a \
         policy",
        domain.kinds().count()
    );
    trial::survive(config, &*domain)?;
    Ok(domain)
}

/// Tries what training needs: the files, like [`check`], and the local simulators if the policies train on them.
pub fn check_for_training(config: &Config) -> Result<Arc<dyn Domain>> {
    ensure!(
        !config.gs.shared_policy || config.simulator == Simulator::Global,
        "gs.shared_policy = true: is for training on the GS, and here simulator = \"{}\"; remove it, or train with \
         --simulator gs (in local simulators policy.average_every_steps gives all agents the mean of their policies)",
        config.simulator.name()
    );
    let domain = check(config)?;
    if config.simulator != Simulator::Global {
        domain.try_local()?;
    }
    Ok(domain)
}

/// Checks that the domain's files could be loaded from a run directory at `path`.
pub fn check_place(config: &Config, path: &Path) -> Result<()> {
    find(config)?.check_place(&path.join(files::NETWORKS))
}

/// Copies the domain's files into the run directory `dir` and returns a config with the paths of the copies.
pub fn keep_files(config: &Config, domain: &dyn Domain, dir: &Path) -> Result<Config> {
    let places = domain.keep_files(&dir.join(files::NETWORKS))?;
    let mut kept = config.clone();
    let paths = kept.domain.iter_mut().flat_map(DomainConfig::paths);
    paths.zip(places).for_each(|((_, path), place)| *path = Path::new(files::NETWORKS).join(place));
    Ok(kept)
}

/// Says what of the domain's files is not simulated.
pub fn tell_left_out(domain: &dyn Domain) {
    domain.left_out().iter().for_each(|what| tell(for_terminal(&format!("note: {what}"))));
}
