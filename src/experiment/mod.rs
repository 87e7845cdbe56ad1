//! Experiments: a grid of runs (scenario x simulator x F x seed x settings), named in one file.
//!
//! - [`mod@file`]: the TOML and the runs that it means.
//! - [`progress`]: what of it is done already. The run directories are the only memory: a killed experiment loses nothing.
//! - [`estimate`]: time and memory, from runs that are there.
//! - [`schedule`]: how many runs stand beside each other on so many cores.
//!
//! This room starts nothing: `run` does.

pub mod estimate;
pub mod file;
pub mod progress;
pub mod schedule;
