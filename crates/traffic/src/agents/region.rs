//! The local region of one intersection: its four incoming edges and the shape of the agent's observation of them.
//!
//! An incoming edge is 100 m long. It is cut into cells of 10 m, counted from the stop line. The agent sees nine of
//! them. It does not see the tenth, the *entry cell*, where influence enters. Cars inside the intersection belong to no
//! edge.

use super::phases::Light;
use crate::config::{DSet, Observation, TrafficConfig};
use crate::side::Side;
use crate::sim::readings::COLUMNS;
use dials_core::domain::{RegionSpec, SourceSpec};

/// Number of incoming edges, in the order of [`Side::ALL`]. Each is an influence source.
pub(crate) const EDGES: usize = Side::ALL.len();
pub const CELLS: usize = 9;
pub(crate) const CELL_M: f64 = 10.0;
pub(crate) const EDGE_M: f64 = 100.0;
pub(crate) const SPEED_LIMIT_MPS: f64 = 10.0;
/// Number of cells that an agent or its AIP sees.
pub const OCCUPANCY: usize = EDGES * CELLS;

pub fn spec(config: &TrafficConfig) -> RegionSpec {
    let &TrafficConfig { horizon, observation, d_set, clock, .. } = config;
    let clock = clock.unwrap_or(0);
    let cars = match observation {
        // A grid has no buses; its config is checked for that.
        Observation::Cells | Observation::CellsAndBuses => OCCUPANCY,
        Observation::Queues => 2 * EDGES,
        // Two on each edge.
        Observation::Detectors => 2 * COLUMNS * EDGES,
        Observation::Lanes => unreachable!("a grid's config is checked for it"),
    };
    let beside_cells = match d_set {
        DSet::Cells => 0,
        DSet::CellsAndArrivals => EDGES,
        DSet::CellsAndLight => Light::ALL.len(),
    };
    RegionSpec {
        obs_dim: cars + Light::ALL.len() + clock,
        d_set_dim: OCCUPANCY + beside_cells + clock,
        n_actions: 2,
        sets: None,
        masks: false,
        sources: SourceSpec::bits(EDGES),
        horizon,
        local_horizon: horizon,
    }
}
