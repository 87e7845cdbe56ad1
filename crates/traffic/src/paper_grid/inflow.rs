//! How often cars arrive at the boundary of a grid.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};

use super::grid::Grid;

/// Probability of a car per step, on each road that leads in.
#[derive(Debug, Clone, PartialEq)]
pub struct Inflow {
    everywhere: f64,
    /// Dead ends with a probability of their own, such as `w0`.
    at: BTreeMap<String, f64>,
}

impl From<f64> for Inflow {
    fn from(everywhere: f64) -> Self {
        Self { everywhere, at: BTreeMap::new() }
    }
}

impl Inflow {
    /// Gives some dead ends a probability of their own. The last one of a dead end counts.
    pub fn with(mut self, at: impl IntoIterator<Item = (String, f64)>) -> Self {
        self.at.extend(at);
        self
    }

    /// Returns the probability at a dead end. SUMO refuses a flow of probability 0: `None`.
    pub(super) fn at(&self, dead_end: &str) -> Option<f64> {
        let probability = *self.at.get(dead_end).unwrap_or(&self.everywhere);
        (probability > 0.0).then_some(probability)
    }

    pub(super) fn check(&self, grid: Grid) -> Result<()> {
        let range = 0.0..=1.0;
        ensure!(range.contains(&self.everywhere), "inflow = {}: must be a probability, from 0 to 1", self.everywhere);
        let dead_ends: Vec<String> = grid.boundary_routes().iter().map(|route| route.from.to_string()).collect();
        for (dead_end, probability) in &self.at {
            let what = format!("inflow at {dead_end:?} = {probability}");
            ensure!(range.contains(probability), "{what}: must be a probability, from 0 to 1");
            let all = dead_ends.join(", ");
            ensure!(dead_ends.contains(dead_end), "{what}: a grid of {grid} has no such dead end; it has {all}");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_inflow_is_a_probability_at_a_dead_end_of_the_grid() {
        let error = |inflow: Inflow| inflow.check(Grid::SINGLE).unwrap_err().to_string();
        let at = |dead_end: &str, probability| Inflow::from(0.1).with([(dead_end.to_owned(), probability)]);
        assert!(error(at("w0", 1.5)).ends_with("must be a probability, from 0 to 1"));
        let elsewhere = "inflow at \"w1\" = 0.5: a grid of 1x1 has no such dead end; it has w0, s0, e0, n0";
        assert_eq!(error(at("w1", 0.5)), elsewhere);
        assert_eq!(["w0", "s0"].map(|dead_end| at("w0", 0.0).at(dead_end)), [None, Some(0.1)]);
    }
}
