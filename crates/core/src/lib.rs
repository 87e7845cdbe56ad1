//! What simulators and learning agree on, and what every crate uses.
//!
//! - [`domain`]: the traits between simulators and learning.
//! - [`base`]: seeds, tables of numbers, statistics, times.
//! - [`outside`]: files and names that others wrote, read and shown safely.

pub mod base;
pub mod domain;
pub mod outside;
