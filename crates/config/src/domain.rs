//! The table of a config that says which domain is simulated, and how.

use std::path::PathBuf;

use anyhow::Result;

use super::{ScenarioConfig, TrafficConfig, WarehouseConfig};

/// A domain with its table. A new domain needs a variant here, a line in `DomainConfig::table` and its key in
/// `written`.
#[derive(Clone, Debug, PartialEq)]
pub enum DomainConfig {
    /// Traffic on a grid of ours.
    Traffic(TrafficConfig),
    /// Traffic on a net of the user. Its table is `[traffic]`, too.
    Scenario(ScenarioConfig),
    Warehouse(WarehouseConfig),
}

/// What the table of every domain must provide.
pub trait DomainTable {
    /// Returns the table's name in a config, which is the domain's name.
    fn name(&self) -> &'static str;

    /// Returns the number of steps of an episode, the table's key `horizon`.
    fn horizon(&self) -> usize;

    /// Returns the number of steps of an episode of the local simulators.
    fn local_horizon(&self) -> usize {
        self.horizon()
    }

    /// Returns an error that names the key if a value makes no sense. The horizon is checked elsewhere, for all
    /// domains.
    fn check(&self) -> Result<()>;

    /// Returns the keys that name files, with their values.
    fn paths(&mut self) -> Vec<(&'static str, &mut PathBuf)> {
        Vec::new()
    }

    /// Returns the keys that only local simulators read. On the global simulator (GS) they change nothing.
    fn local_keys(&self) -> &'static [&'static str] {
        &[]
    }
}

impl DomainConfig {
    fn table(&self) -> &dyn DomainTable {
        match self {
            DomainConfig::Traffic(table) => table,
            DomainConfig::Scenario(table) => table,
            DomainConfig::Warehouse(table) => table,
        }
    }

    fn table_mut(&mut self) -> &mut dyn DomainTable {
        match self {
            DomainConfig::Traffic(table) => table,
            DomainConfig::Scenario(table) => table,
            DomainConfig::Warehouse(table) => table,
        }
    }

    /// See [`DomainTable::name`].
    pub fn name(&self) -> &'static str {
        self.table().name()
    }

    /// See [`DomainTable::horizon`].
    pub fn horizon(&self) -> usize {
        self.table().horizon()
    }

    /// See [`DomainTable::local_horizon`].
    pub fn local_horizon(&self) -> usize {
        self.table().local_horizon()
    }

    /// See [`DomainTable::check`].
    pub fn check(&self) -> Result<()> {
        self.table().check()
    }

    /// See [`DomainTable::paths`].
    pub fn paths(&mut self) -> Vec<(&'static str, &mut PathBuf)> {
        self.table_mut().paths()
    }

    /// See [`DomainTable::local_keys`].
    pub fn local_keys(&self) -> &'static [&'static str] {
        self.table().local_keys()
    }

    /// Returns a key of this table with the table's name before it, as `--set` takes it.
    pub fn key(&self, key: &str) -> String {
        format!("{}.{key}", self.name())
    }
}
