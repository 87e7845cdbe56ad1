//! Experiments: a grid of runs (scenario x simulator x F x seed x settings), described in one file.
//!
//! - [`mod@file`]: the TOML file and the runs that it plans.
//! - [`progress`]: which of them are done. Only the run directories record this, so a killed experiment loses nothing.
//! - [`estimate`]: time and memory, estimated from existing runs.
//! - [`schedule`]: which runs share the cores at the same time.
//!
//! This room starts no runs: `run` does.

/// Folder of the logs of the processes, in the folder of the runs.
pub const LOGS: &str = "logs";

pub mod estimate;
pub mod file;
pub mod progress;
pub mod schedule;
