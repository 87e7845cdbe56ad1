//! The paper's grid: made, written to files that SUMO and sumo-gui can open, and recognised again.
//!
//! Making a network twice gives the same files byte for byte. The *local* net is the 1x1 grid without flows, because
//! its cars are sampled.

mod compare;
mod content;
mod expected;
pub mod grid;
pub mod inflow;
pub mod make;
pub mod plans;
pub mod recognise;

/// Probability of a car per step on each edge that leads in, in the authors' setup.
const INFLOW: f64 = 0.1;
