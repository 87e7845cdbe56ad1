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

/// Label of an axis, and format of its numbers.
#[derive(Clone)]
pub(crate) struct Axis {
    pub(crate) label: String,
    pub(crate) format: fn(f64) -> String,
}

/// Returns the ends of these values; of none, an empty range from infinity.
fn ends_of(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawing::Svg;

    const ODD: [f64; 12] =
        [f64::MAX, f64::MIN, 1e300, -1e300, 1e15, 5e-324, -0.0, 0.0, 1.0, -3.0, f64::INFINITY, f64::NAN];

    fn axis() -> Axis {
        Axis { label: String::new(), format: |value| format!("{value:.1}") }
    }

    fn lines(first: f64, second: f64) -> LineChart {
        let point = |x: f64, y: f64| LinePoint { x, y, band: Some((second, first)), whole: true };
        let line = Line {
            label: "a".to_owned(),
            look: Look::FIRST,
            points: vec![point(0.0, first), point(1.0, second), point(first, second)],
            companion: vec![(0.0, second), (second, first)],
            seeds: vec![vec![(0.0, first), (1.0, second)]],
        };
        LineChart {
            title: String::new(),
            x: axis(),
            y: axis(),
            lines: vec![line.clone(), line],
            companions: None,
            levels: vec![Level { label: String::new(), name: String::new(), y: second, measured: true }],
            marks: vec![Mark { label: String::new(), look: Look::FIRST, points: vec![(first, second, Some(first))] }],
            x_end: 0.0,
            note: String::new(),
        }
    }

    fn bars(scale: Scale, first: f64, second: f64) -> Result<Svg> {
        let bar = |value: f64| Bar {
            label: "a".to_owned(),
            look: Look::FIRST,
            value: Some(value),
            whisker: Some((second, first)),
            points: vec![first, second],
            paper: Some(second),
        };
        let clusters = vec![Cluster { label: "4".to_owned(), bars: vec![bar(first), bar(second)] }];
        let [title, note] = [const { String::new() }; 2];
        BarChart { title, y: axis(), format: axis().format, scale, clusters, note }.draw()
    }

    fn named(first: f64, second: f64) -> Result<Svg> {
        let values = vec![(first, true), (second, false)];
        let series = vec![Series { label: "a".to_owned(), look: Look::FIRST, values }];
        let names = vec!["a".repeat(100), "b".to_owned()];
        NamedChart { title: String::new(), x: axis(), names, series, note: String::new() }.draw()
    }

    #[test]
    fn whatever_the_values_are_a_chart_is_drawn() {
        for first in ODD {
            for second in ODD {
                let lines = lines(first, second);
                for svg in [
                    lines.draw(),
                    lines.draw_against(0),
                    bars(Scale::Linear, first, second),
                    bars(Scale::Log2, first, second),
                    named(first, second),
                ] {
                    roxmltree::Document::parse(&svg.unwrap().file()).unwrap();
                }
            }
        }
    }
}
