//! Words that every room speaks: seeds, rows of numbers, ids and units, stopwatches, statistics.
//!
//! Nothing here knows about simulators, networks or learning, and nothing here does input or output.

mod compact;
mod purpose;
mod ragged;
mod rows;
mod seed;
pub mod statistics;
mod stopwatch;
mod units;
mod vectors;
mod work;

pub use compact::CompactRows;
pub use purpose::RandomPurpose;
pub use ragged::Ragged;
pub use rows::Rows;
pub use seed::{Dice, Seed, scramble};
pub use stopwatch::{Activity, Phase, Stopwatch, Timesheet};
pub use units::AgentId;
pub use vectors::VectorWidth;
pub use work::Work;
