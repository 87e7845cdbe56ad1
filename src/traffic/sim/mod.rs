//! The simulators of traffic on SUMO.
//!
//! - [`global`]: the global simulator (GS); [`local`]: the local simulators (LS) of many regions.
//! - `handles`: the intersections of a loaded net.
//! - `metrics`, `trips`: what only evaluations measure.
//! - [`recording`], [`replay`]: an episode written down, and as files that SUMO plays.

pub mod global;
pub(super) mod handles;
pub mod local;
mod metrics;
pub mod recording;
pub mod replay;
mod trips;
