//! Networks as files.
//!
//! - [`tree`]: XML read as a tree.

pub mod tree;
