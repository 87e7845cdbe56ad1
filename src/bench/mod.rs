//! How fast a config trains: orders of every kind to a real fleet, timed, and what a whole run would cost by them.
//!
//! - [`measure`]: gives the orders, a few of each, and keeps what they took.
//! - [`costs`]: from there to core-microseconds per agent-step of the run that the config describes, with everything as often as
//!   [`crate::cost`] counts it.
//! - [`floor`]: the arithmetic that cannot be avoided, counted from the shapes of the networks.
//! - `marginals`: AIPs under which local simulators are as busy as in a run.
//! - [`table`]: the costs for people and for programs.
//!
//! This room does not know which fleet it is given, and keeps nothing of what the agents learn.

pub mod costs;
pub mod floor;
mod marginals;
pub mod measure;
pub mod table;
