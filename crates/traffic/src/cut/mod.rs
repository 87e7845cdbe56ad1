//! Local regions cut out of a network.
//!
//! - [`forest`]: many copies of the grid's local net side by side in one SUMO net.
//! - [`local_net`]: the net of one light of any network. `extract` cuts it out of a whole one; [`beyond`]: copies
//!   of edges behind the exits.
//! - [`mixed`]: many different local nets in one SUMO net, each lane with random numbers of its own.
//! - [`of_scenario`]: the local net of a light of a scenario, and its files. `sample_demand`: some cars for it.
//! - [`names`]: names with a prefix.

pub mod beyond;
mod extract;
pub mod forest;
pub(crate) mod local_net;
pub mod mixed;
pub(crate) mod names;
pub mod of_scenario;
mod sample_demand;
