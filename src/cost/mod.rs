//! What a whole run of a config costs: the one place that counts how often a run does what.
//!
//! - `workload`: how much of everything a run is, from its schedule.
//! - `prices`: what one of everything costs, and from there what the run costs.
//!
//! [`mod@crate::bench`] brings prices from short orders to a real fleet, [`crate::experiment`] from runs that are done. What a price
//! is counted in is theirs to say: seconds, or microseconds with their parts.

mod prices;
mod workload;

pub use prices::{Prices, RunCost};
pub use workload::Workload;
