//! What is filmed.

use std::path::{Path, PathBuf};

/// An episode that sumo-gui plays.
pub struct Replay<'a> {
    /// Path of what `sumo-gui -c` takes.
    pub config: &'a Path,
    /// Number of steps, each of which is a picture.
    pub steps: usize,
    /// Intersections from west to east and from south to north, which give the film its shape.
    pub columns: usize,
    pub rows: usize,
    /// Returns sumo-gui's settings under which it writes these pictures, the i-th before step i.
    pub settings: &'a dyn Fn(&[PathBuf]) -> String,
}
