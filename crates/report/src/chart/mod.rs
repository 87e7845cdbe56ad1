//! Charts of numbers: lines, rows, bars and heat maps. Each method has a colour, a dash and a marker, so that charts
//! can be read in black and white too.
//!
//! - `lines`, `rows` (means of an ablation, and named things), `bars`, `heat`: the kinds of charts.
//! - `legend`: samples with labels; `look`: colour, dash and marker of each method.

mod bars;
mod heat;
mod legend;
mod lines;
mod look;
mod rows;

use std::ops::Range;

use anyhow::Result;
use plotters::coord::CoordTranslate;
use plotters::prelude::*;

use crate::drawing::{BoundedAxis, pen, px};

pub(crate) use bars::{Bar, BarChart, Cluster, Scale};
pub(crate) use heat::{HeatMap, Panel};
pub(crate) use lines::{Level, Line, LineChart, LinePoint, MOST_BANDS, Mark};
pub(crate) use look::{Look, Looks, Marker};
pub(crate) use rows::{NamedChart, Row, RowChart, Series};

/// Width of a chart, and of the legend in it.
const WIDTH: u32 = 860;
const LEGEND: u32 = 250;
/// Least height of a chart with a legend.
const HEIGHT: u32 = 400;
/// Largest width of the numbers at a vertical axis, in pixels. Longer numbers reach into the margin.
const MOST_FOR_NUMBERS: u32 = 130;

type Plot<'a> = DrawingArea<SVGBackend<'a>, Cartesian2d<BoundedAxis, BoundedAxis>>;

#[derive(Clone)]
pub(crate) struct Axis {
    pub(crate) label: String,
    pub(crate) format: fn(f64) -> String,
}

/// Widens a range by a margin at both ends.
fn with_air((low, high): (f64, f64)) -> Range<f64> {
    let air = ((high - low) * 0.05).max(high.abs() * 1e-3).max(1e-6);
    (low - air)..(high + air)
}

/// Draws an error bar: a vertical line with a short bar at each end.
fn whisker<CT: CoordTranslate<From = (f64, f64)>>(
    area: &DrawingArea<SVGBackend<'_>, CT>,
    x: f64,
    (low, high): (f64, f64),
    colour: RGBColor,
) -> Result<()> {
    let style = pen(colour, 1.2);
    area.draw(&PathElement::new(vec![(x, low), (x, high)], style))?;
    for end in [low, high] {
        let foot = PathElement::new(vec![(-px(3.0), 0), (px(3.0), 0)], style);
        area.draw(&(EmptyElement::at((x, end)) + foot))?;
    }
    Ok(())
}
