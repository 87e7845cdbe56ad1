//! Local regions cut out of a network: [`forest`] is for the paper's grids, everything else for scenarios.

pub mod beyond;
mod extract;
pub mod forest;
pub(crate) mod local_net;
pub mod mixed;
pub(crate) mod names;
pub mod of_scenario;
mod sample_demand;
