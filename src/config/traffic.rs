//! The table `[traffic]`.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};

use super::domain::DomainTable;

/// Settings of the traffic domain. GS: global simulator; LS: local simulator; AIP: approximate influence predictor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrafficConfig {
    /// Grid that the GS simulates: its path without `.net.xml`, relative to the config file.
    pub network: PathBuf,
    /// Single intersection that the LS simulates: its path in the same form.
    pub local_network: PathBuf,
    /// Number of steps (seconds) of an episode.
    #[serde(default = "default_horizon")]
    pub horizon: usize,
    /// Inputs of the AIP.
    #[serde(default)]
    pub d_set: DSet,
    /// How a car enters an LS.
    #[serde(default)]
    pub entry: EntryRule,
    /// Value that is added to the initial bias of the logit of "switch".
    #[serde(default)]
    pub initial_switch_bias: f32,
}

/// The d-set (d-separating set) of the traffic domain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DSet {
    /// The 36 occupancy bits of the observation.
    #[default]
    #[serde(rename = "cells")]
    Cells,
    /// The same bits and 4 more: did a car enter this edge in the last step?
    #[serde(rename = "cells+arrivals")]
    CellsAndArrivals,
}

/// How a car enters a local traffic simulator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EntryRule {
    /// At 6 m with 9.5 m/s, or with 3 m/s if more than 8 cars are on the edge.
    #[default]
    Reference,
    /// At 5 m, as fast as is safe.
    Max,
}

fn default_horizon() -> usize {
    300
}

impl DomainTable for TrafficConfig {
    fn name(&self) -> &'static str {
        "traffic"
    }

    fn horizon(&self) -> usize {
        self.horizon
    }

    fn check(&self) -> Result<()> {
        let bias = self.initial_switch_bias;
        ensure!(bias.is_finite(), "traffic.initial_switch_bias = {bias}: must be a finite number");
        Ok(())
    }

    fn paths(&mut self) -> Vec<(&'static str, &mut PathBuf)> {
        vec![("network", &mut self.network), ("local_network", &mut self.local_network)]
    }

    fn local_keys(&self) -> &'static [&'static str] {
        &["local_network", "d_set", "entry"]
    }
}
