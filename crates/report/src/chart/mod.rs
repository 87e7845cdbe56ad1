//! Charts of numbers: lines, rows, bars and heat maps. Each method has a colour, a dash and a marker, so that charts
//! can be read in black and white too.
//!
//! - `lines`, `rows`, `named`, `bars`, `heat`: the five kinds of charts.
//! - `legend`: samples with labels; `look`: colour, dash and marker of each method.

mod bars;
mod heat;
mod legend;
mod lines;
mod look;
mod named;
mod rows;

pub(crate) use bars::{Bar, BarChart, Cluster, Scale};
pub(crate) use heat::{Cell, HeatMap, Panel};
pub(crate) use lines::{Axis, Level, Line, LineChart, LinePoint, MOST_BANDS, Mark};
pub(crate) use look::{Look, Looks, Marker};
pub(crate) use named::{NamedChart, Series};
pub(crate) use rows::{Row, RowChart};
