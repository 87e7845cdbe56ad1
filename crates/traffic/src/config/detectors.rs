//! Faults of detectors.

use anyhow::{Result, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Faults of the detectors that agents see (`observation = "detectors"`, or `"lanes"` with `seen_cars = 0`), such as
/// `{ dead = 0.1, noise = 0.02 }`. They are drawn anew in every episode, each detector for itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorFaults {
    /// Share of detectors that see nothing in the whole episode, from 0 to 1.
    pub dead: f64,
    /// Probability per second that a detector sees a car where there is none, or misses all that are there.
    pub noise: f64,
}

impl DetectorFaults {
    pub(super) fn check(&self, sees_detectors: bool) -> Result<()> {
        for (key, share) in [("dead", self.dead), ("noise", self.noise)] {
            ensure!((0.0..=1.0).contains(&share), "traffic.detector_faults.{key} = {share}: must be from 0 to 1");
        }
        ensure!(
            sees_detectors || *self == DetectorFaults::default(),
            "traffic.detector_faults: only agents that see detectors have them; add observation = \"detectors\", or \"lanes\" with seen_cars = 0"
        );
        Ok(())
    }
}
