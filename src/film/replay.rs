//! The episode that is filmed.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::captions::SpeedColour;

/// An episode that sumo-gui plays.
pub(crate) struct Replay<'a> {
    /// Words above the roads.
    pub title: &'a str,
    /// Colours of cars, from the slowest on.
    pub speeds: &'a [SpeedColour],
    /// Path of the file for `sumo-gui -c`.
    pub config: &'a Path,
    /// Steps that are shown; each becomes one picture.
    pub steps: Range<usize>,
    /// Second at which the episode begins.
    pub begin_s: u64,
    pub shape: Shape,
    /// Function that returns settings with which sumo-gui writes these pictures, the i-th before the i-th of these steps.
    pub settings: &'a dyn Fn(&[PathBuf]) -> String,
}

/// The roads, which give a film its shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Shape {
    /// Numbers of intersections from west to east and from south to north.
    Grid { columns: usize, rows: usize },
    /// Extent from west to east and from south to north, in metres.
    Map { wide_m: f64, tall_m: f64 },
}
