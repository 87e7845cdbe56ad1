//! The table `[warehouse]`.

use std::sync::Arc;

use anyhow::ensure;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Warehouse;
use dials_core::domain::{Domain, DomainTable, Result};

/// Largest side. A larger one is a typing error and would need more memory than any machine has.
const MOST_PER_SIDE: usize = 100;

/// The warehouse: robots that fetch items.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WarehouseConfig {
    /// Number of learning robots along a side of their square. A ring of other robots, which go for the closest item,
    /// surrounds it.
    #[schemars(extend("source" = "C"))]
    pub agents_per_side: usize,
    /// Number of steps of an episode.
    #[serde(default = "default_horizon")]
    #[schemars(extend("source" = "C"))]
    pub horizon: usize,
}

fn default_horizon() -> usize {
    100
}

impl DomainTable for WarehouseConfig {
    fn horizon(&self) -> usize {
        self.horizon
    }

    fn check(&self) -> Result<()> {
        let side = self.agents_per_side;
        ensure!(side >= 1, "warehouse.agents_per_side = {side}: must be at least 1 (the paper uses 2, 5, 7 and 10)");
        ensure!(side <= MOST_PER_SIDE, "warehouse.agents_per_side = {side}: must be at most {MOST_PER_SIDE}");
        Ok(())
    }
    fn open(&self) -> Result<Arc<dyn Domain>> {
        Ok(Arc::new(Warehouse::new(self)))
    }
}
