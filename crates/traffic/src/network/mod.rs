//! Networks as files, from any source. [`tree`] reads XML, `xml` writes it.

pub mod contents;
pub mod files;
pub(crate) mod loadable;
pub(super) mod memory_file;
pub mod osm;
pub(crate) mod other_files;
pub mod roads;
pub mod way_out;
pub(super) mod xml;

pub use dials_core::outside::tree;
