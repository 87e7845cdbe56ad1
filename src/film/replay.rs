//! The episode that is filmed.

use std::path::{Path, PathBuf};

/// An episode that sumo-gui plays.
pub struct Replay<'a> {
    /// Path of the file for `sumo-gui -c`.
    pub config: &'a Path,
    /// Number of steps; each becomes one picture.
    pub steps: usize,
    /// Number of intersections from west to east. With `rows` it gives the film its shape.
    pub columns: usize,
    /// Number of intersections from south to north.
    pub rows: usize,
    /// Function that returns settings with which sumo-gui writes these pictures, the i-th before step i.
    pub settings: &'a dyn Fn(&[PathBuf]) -> String,
}
