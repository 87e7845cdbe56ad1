//! Local regions cut out of a network.
//!
//! - [`forest`]: many regions side by side in one SUMO net.

pub mod forest;
