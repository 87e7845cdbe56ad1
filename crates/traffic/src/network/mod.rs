//! Networks as files, from any source.
//!
//! - [`files`]: the files of a network; [`way_out`]: advice if they are missing or wrong.
//! - [`contents`]: a network read once, for everything that is done with it; [`loadable`]: what of it SUMO loads, as texts
//!   in memory (`memory_file`).
//! - [`roads`]: what a net is: junctions, edges, lanes, connections, programs of lights.
//! - `other_files`: attributes by which SUMO would write or read another file, refused.
//! - `xml`: XML written. It is read into trees by [`tree`].

pub mod contents;
pub mod files;
pub(crate) mod loadable;
pub(super) mod memory_file;
mod other_files;
pub mod roads;
pub mod way_out;
pub(super) mod xml;

pub use dials_core::outside::tree;
