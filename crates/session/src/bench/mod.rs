//! How fast a config trains: orders of every kind to a real fleet, timed, and the cost of a whole run extrapolated from
//! them.
//!
//! - [`measure`]: gives the orders, a few of each, and keeps their times.
//! - [`costs`]: the costs of the whole run of a config, in core-microseconds per agent-step, and what a step of a simulator
//!   costs by itself. [`crate::cost`] counts how often everything happens.
//! - `floor`: a lower bound: the arithmetic of the networks, counted from their shapes.
//! - `marginals`: AIPs with which local simulators are as busy as in a run.
//! - [`table`]: the costs for people and for programs.
//!
//! This room does not know which fleet it is given, and keeps nothing of what the agents learn.

pub mod costs;
mod floor;
mod marginals;
pub mod measure;
pub mod table;
