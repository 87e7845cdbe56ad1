//! The cost of a whole run of a config. Only this room counts how often a run does what.
//!
//! - `workload`: the amounts of work in a run, from its schedule.
//! - `prices`: the cost of one unit of each kind of work, and the cost of the run.
//!
//! [`mod@crate::bench`] gets prices from short orders to a real fleet, [`crate::experiment`] from other runs. They
//! choose the unit of a price: seconds, or microseconds with their parts.

mod prices;
mod workload;

pub use prices::{Prices, RunCost};
pub use workload::Workload;
