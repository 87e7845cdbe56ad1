//! Charts with a row for each mean of an ablation, or for each named thing, such as the agents of a network.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::legend::{self, LegendEntry, LegendSample};
use super::look::{Dash, Look, Marker, mark, stroke};
use super::{Axis, LEGEND, WIDTH, with_air};
use crate::drawing::{Area, BoundedAxis, INK, SCALE, Svg, draw_mesh, ends_of, pen, px, text_width, write, write_at};

/// Height of an axis of a row chart, and of the note below it.
const AXIS: u32 = 48;
const NOTE: u32 = 22;
/// Height of the title of a row chart with the header of its columns.
const HEADER: u32 = 50;
/// Width of the labels at the left of a row chart, and of the words at its right.
const LABELS: u32 = 230;
const WORDS: u32 = 330;
/// Right ends of the columns of words, measured from the right of the picture.
const COLUMNS: [u32; 3] = [276, 66, 8];
const LINE: u32 = 14;
const WRAP: usize = 36;

/// Height of a named row, of the title above them and of the axis below them.
const NAMED_ROW: u32 = 16;
const TITLE: u32 = 34;
const NAMED_AXIS: u32 = 52;
const NAMES: u32 = 190;
/// Longest line of a name, in letters, and the height that each further line adds to all rows.
const NAMED_LETTERS: usize = 60;
const NAMED_LINE: u32 = 13;

pub(crate) struct Row {
    pub(crate) label: String,
    /// Values of single seeds, drawn as hollow circles.
    pub(crate) points: Vec<f64>,
    pub(crate) mean: f64,
    pub(crate) interval: Option<(f64, f64)>,
    /// Words at the right, one per column.
    pub(crate) words: [String; 3],
}

/// A chart of an ablation, with a vertical line at the mean of the reference.
pub(crate) struct RowChart {
    pub(crate) title: String,
    pub(crate) x: Axis,
    /// Rows from top to bottom; the first is the reference.
    pub(crate) rows: Vec<Row>,
    pub(crate) header: [String; 3],
    pub(crate) note: String,
}

/// The values of one method, in the order of the names, and whether the thing is stuck.
pub(crate) struct Series {
    pub(crate) label: String,
    pub(crate) look: Look,
    pub(crate) values: Vec<(f64, bool)>,
}

/// A chart of named things: a row per name, a marker per method.
pub(crate) struct NamedChart {
    pub(crate) title: String,
    pub(crate) x: Axis,
    pub(crate) names: Vec<String>,
    pub(crate) series: Vec<Series>,
    pub(crate) note: String,
}

/// Where the rows of a chart are, in pixels: top and height, left and right margins, and the height of the axis.
struct Rows {
    top: u32,
    height: u32,
    left: u32,
    right: u32,
    axis: u32,
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<BoundedAxis, BoundedAxis>>;

impl Rows {
    /// Draws the horizontal axis for these values. Rows have negative y, from 0 down.
    fn chart<'a, 'b>(&self, root: &'a Area<'b>, x: &Axis, values: impl Iterator<Item = f64>) -> Result<Chart<'a, 'b>> {
        let below = root.dim_in_pixel().1 as i32 - px(self.top + self.height + self.axis);
        let mut chart = ChartBuilder::on(root)
            .margin_top(px(self.top))
            .margin_bottom(below)
            .margin_left(px(self.left))
            .margin_right(px(self.right))
            .x_label_area_size(px(self.axis))
            .build_cartesian_2d(
                BoundedAxis::from(with_air(ends_of(values))),
                BoundedAxis::from(-f64::from(self.height)..0.0),
            )?;
        let format = |value: &f64| (x.format)(*value);
        let mut mesh = chart.configure_mesh();
        let mesh = mesh.disable_y_mesh().disable_y_axis().x_labels(6).x_desc(&x.label);
        draw_mesh(mesh.x_label_formatter(&format), 12.0)?;
        Ok(chart)
    }
}

impl RowChart {
    pub(crate) fn draw(&self) -> Result<Svg> {
        let labels: Vec<Vec<String>> = self.rows.iter().map(|row| legend::in_lines(&row.label, WRAP)).collect();
        let heights: Vec<u32> = labels.iter().map(|lines| (lines.len() as u32 * LINE + 10).max(26)).collect();
        let all: u32 = heights.iter().sum();
        let middles: Vec<f64> = (0..heights.len())
            .map(|row| f64::from(heights[..row].iter().sum::<u32>()) + f64::from(heights[row]) / 2.0)
            .collect();
        Svg::draw(WIDTH, HEADER + all + AXIS + NOTE, |root| {
            write(root, &self.title, (px(12), px(8)), 15)?;
            let ends = self.rows.iter().filter_map(|row| row.interval).flat_map(|(low, high)| [low, high]);
            let ends = ends.chain(self.rows.iter().map(|row| row.mean));
            let values = self.rows.iter().flat_map(|row| row.points.iter().copied()).chain(ends);
            let rows = Rows { top: HEADER, height: all, left: LABELS, right: WORDS, axis: AXIS };
            let chart = rows.chart(root, &self.x, values)?;
            let area = chart.plotting_area();
            let reference = &self.rows[0];
            if let Some((low, high)) = reference.interval {
                let corners = [(low, 0.0), (high, -f64::from(all))];
                area.draw(&Rectangle::new(corners, INK.mix(0.1).filled()))?;
            }
            let line = vec![(reference.mean, 0.0), (reference.mean, -f64::from(all))];
            stroke(area, line, (INK.to_rgba(), Dash::Dashed), 1.2)?;
            for (index, (row, &middle)) in self.rows.iter().zip(&middles).enumerate() {
                let colour = if index == 0 { INK } else { Look::FIRST.colour };
                let look = |marker| Look { colour, dash: Dash::Solid, marker };
                if let Some((low, high)) = row.interval {
                    let ends = vec![(low, -middle), (high, -middle)];
                    stroke(area, ends, (colour.to_rgba(), Dash::Solid), 3.0)?;
                }
                for &point in &row.points {
                    mark(area, (point, -middle), look(Marker::Circle), 8.0, false)?;
                }
                mark(area, (row.mean, -middle), look(Marker::Diamond), 9.0, true)?;
            }
            for (lines, &middle) in labels.iter().zip(&middles) {
                let top = f64::from(HEADER) + middle - (lines.len() - 1) as f64 * f64::from(LINE) / 2.0;
                for (number, line) in lines.iter().enumerate() {
                    let at = (px(LABELS - 10), px(top + number as f64 * f64::from(LINE)));
                    write_at(root, line, at, 12, (HPos::Right, VPos::Center))?;
                }
            }
            let places = std::iter::once(-16.0).chain(middles.iter().copied());
            let all_words = std::iter::once(&self.header).chain(self.rows.iter().map(|row| &row.words));
            for (place, words) in places.zip(all_words) {
                for (word, right) in words.iter().zip(COLUMNS) {
                    let at = (px(WIDTH - right), px(f64::from(HEADER) + place));
                    write_at(root, word, at, 12, (HPos::Right, VPos::Center))?;
                }
            }
            write(root, &self.note, (px(12), px(HEADER + all + AXIS + 4)), 11)
        })
    }
}

impl NamedChart {
    pub(crate) fn draw(&self) -> Result<Svg> {
        let series = self.series.iter().map(|series| LegendEntry::new(LegendSample::Mark(series.look), &series.label));
        let entries: Vec<LegendEntry> = series.chain([LegendEntry::new(LegendSample::Nothing, &self.note)]).collect();
        let names: Vec<Vec<String>> = self.names.iter().map(|name| legend::in_lines(name, NAMED_LETTERS)).collect();
        let most_lines = names.iter().map(Vec::len).max().unwrap_or(1);
        let row_height = NAMED_ROW + NAMED_LINE * (most_lines as u32 - 1);
        let rows = self.names.len() as u32 * row_height;
        let height = TITLE + (rows + NAMED_AXIS).max(legend::height(&entries));
        let widest = names.iter().flatten().map(|line| text_width(line, 11.0) as u32 / SCALE).max().unwrap_or(0);
        let left = NAMES.max(widest + 12);
        let width = WIDTH + left - NAMES;
        Svg::draw(width, height, |root| {
            write(root, &self.title, (px(12), px(8)), 15)?;
            let (_, right) = root.split_horizontally(px(width - LEGEND));
            legend::draw(&right.margin(px(TITLE), 0, px(6), 0), &entries)?;
            let values = self.series.iter().flat_map(|series| series.values.iter().map(|(value, _)| *value));
            let rows = Rows { top: TITLE, height: rows, left, right: LEGEND + 12, axis: NAMED_AXIS };
            let chart = rows.chart(root, &self.x, values)?;
            let area = chart.plotting_area();
            let x = area.get_x_range();
            for (row, lines) in names.iter().enumerate() {
                let middle = f64::from(row_height) * (row as f64 + 0.5);
                area.draw(&PathElement::new([(x.start, -middle), (x.end, -middle)], pen(INK.mix(0.13), 1)))?;
                let first = f64::from(TITLE) + middle - f64::from(NAMED_LINE) * (lines.len() - 1) as f64 / 2.0;
                for (number, line) in lines.iter().enumerate() {
                    let at = (px(left - 8), px(first + f64::from(NAMED_LINE) * number as f64));
                    write_at(root, line, at, 11, (HPos::Right, VPos::Center))?;
                }
                for series in &self.series {
                    let (value, stuck) = series.values[row];
                    mark(area, (value, -middle), series.look, 8.0, true)?;
                    if stuck {
                        let cross = Look { colour: INK, marker: Marker::Cross, ..series.look };
                        mark(area, (value, -middle), cross, 12.0, true)?;
                    }
                }
            }
            Ok(())
        })
    }
}
