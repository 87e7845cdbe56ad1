//! The config of a run: from one TOML file to checked settings, and back.
//!
//! A config is read once, checked once, and passed on. Every table has its owner: learning, a domain, or this crate.
//! They share one file. No other room reads files or flags for settings.
//!
//! - `load`: from a file and `--set` to a [`RunConfig`], and back. `split`: which of the owners reads which key.
//! - [`mod@schema`]: the JSON schema of a config, for editors. docs/configuration.md is made from it, too.
//! - [`resume`]: what may change when a run is resumed.

mod load;
pub mod resume;
pub mod schema;
mod split;

use anyhow::{Result, ensure};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

use crate::domains::DomainConfig;
use dials_core::domain::DomainTable;
use dials_learn::config::{Config, Simulator};
use stacknets::VectorWidth;

pub use load::{LARGEST_FILE, load, load_kept, to_toml};
pub use resume::CHANGEABLE;
pub use schema::schema;

/// A run: what is simulated, how agents learn, and what is written.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunConfig {
    #[serde(flatten)]
    pub learning: Config,
    /// Domain of the run, from the one table of a domain in the config. `None` for a domain that does not come from a
    /// config.
    #[serde(flatten)]
    pub domain: Option<DomainConfig>,
    pub logging: LoggingConfig,
    pub numerics: NumericsConfig,
}

/// Further files of a run besides its CSV files.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LoggingConfig {
    /// Whether to write an event file for TensorBoard, with the numbers of the CSV files; `--tensorboard` sets it.
    pub tensorboard: bool,
}

/// A run's arithmetic.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NumericsConfig {
    /// Width of the vector registers that multiply matrices. `"widest"` is fastest. `"256-bit"` gives the same files on
    /// every x86-64 machine with AVX2 and FMA.
    #[schemars(schema_with = "vector_widths")]
    pub vector_width: VectorWidth,
}

fn vector_widths(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "enum": [VectorWidth::Widest, VectorWidth::Bits256] })
}

impl From<Config> for RunConfig {
    /// Returns the config of a run in a domain that does not come from a config.
    fn from(learning: Config) -> RunConfig {
        RunConfig { learning, ..RunConfig::default() }
    }
}

/// Largest number of steps of an episode. A larger one must be a typing error.
const MOST_STEPS: usize = 1_000_000;

impl RunConfig {
    fn table(&self) -> &dyn DomainTable {
        self.domain.as_ref().expect("a config that was loaded has a domain").table()
    }

    /// Returns whether several simulators of this domain are processes of their own.
    pub fn has_foreign_simulator(&self) -> bool {
        matches!(self.domain, Some(DomainConfig::Traffic(_)))
    }

    /// Returns the number of steps of an episode of the config's domain.
    pub fn horizon(&self) -> usize {
        self.table().horizon()
    }

    /// Returns the number of steps of an episode of what the policies train on: the GS (global simulator) or local ones.
    pub(crate) fn training_horizon(&self) -> usize {
        if self.learning.simulator == Simulator::Global { self.horizon() } else { self.table().local_horizon() }
    }

    /// Returns an error that names the key if a value makes no sense.
    fn check(&self) -> Result<()> {
        let Some(domain) = &self.domain else { return self.learning.check() };
        domain.table().check()?;
        let (key, horizon) = (domain.key("horizon"), domain.table().horizon());
        ensure!(
            horizon >= 1,
            "{key} = {horizon}: must be at least 1 (the paper uses 300 for traffic and 100 for the warehouse)"
        );
        ensure!(horizon <= MOST_STEPS, "{key} = {horizon}: must be at most {MOST_STEPS}");
        self.learning.check()?;
        if domain.table().shows_sets() {
            self.learning.check_for_sets(&domain.key("observation"))?;
        }
        self.learning.check_datasets(horizon)
    }
}
