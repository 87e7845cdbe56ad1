//! Networks as files, whoever made them.
//!
//! - [`files`]: which files a network is; `together`: several files written at once; `way_out`: what to do without them.
//! - `tree`, `xml`: XML read and written.

pub mod files;
mod together;
pub(super) mod tree;
pub(super) mod way_out;
pub(super) mod xml;

pub(super) use together::write_together;
