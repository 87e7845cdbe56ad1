//! Networks as files, from any source.
//!
//! - [`files`]: the files of a network; `together`: several files written at once; `way_out`: advice if they are
//!   missing or wrong.
//! - `tree`: XML read into a tree; `xml`: XML written.

pub mod files;
mod together;
pub(super) mod tree;
pub(super) mod way_out;
pub(super) mod xml;

pub(super) use together::write_together;
