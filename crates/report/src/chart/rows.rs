//! Row charts, for ablations: a mean per row, and a vertical line at the mean of the reference.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::legend;
use super::lines::Axis;
use super::look::{Dash, Look, Marker, mark, stroke};
use crate::drawing::{BoundedAxis, INK, Svg, draw_mesh, px, text};

const WIDTH: u32 = 860;
/// Width of the labels at the left.
const LABELS: u32 = 230;
/// Width of the words at the right.
const WORDS: u32 = 330;
/// Right ends of the columns of words, measured from the right of the picture.
const COLUMNS: [u32; 3] = [276, 66, 8];
const TITLE: u32 = 50;
const AXIS: u32 = 48;
const NOTE: u32 = 22;
const LINE: u32 = 14;
/// Largest number of characters in a line of a label.
const WRAP: usize = 36;

pub(crate) struct Row {
    pub(crate) label: String,
    /// Values of single seeds, drawn as hollow circles.
    pub(crate) points: Vec<f64>,
    pub(crate) mean: f64,
    pub(crate) interval: Option<(f64, f64)>,
    /// Words at the right, one per column.
    pub(crate) words: [String; 3],
}

pub(crate) struct RowChart {
    pub(crate) title: String,
    pub(crate) x: Axis,
    /// Rows from top to bottom; the first is the reference.
    pub(crate) rows: Vec<Row>,
    /// Headings of the columns of words.
    pub(crate) header: [String; 3],
    pub(crate) note: String,
}

impl RowChart {
    pub(crate) fn draw(&self) -> Result<Svg> {
        let labels: Vec<Vec<String>> = self.rows.iter().map(|row| legend::in_lines(&row.label, WRAP)).collect();
        let heights: Vec<u32> = labels.iter().map(|lines| (lines.len() as u32 * LINE + 10).max(26)).collect();
        let all: u32 = heights.iter().sum();
        let middles: Vec<f64> = (0..heights.len())
            .map(|row| f64::from(heights[..row].iter().sum::<u32>()) + f64::from(heights[row]) / 2.0)
            .collect();
        Svg::draw(WIDTH, TITLE + all + AXIS + NOTE, |root| {
            let title = Text::new(self.title.clone(), (px(12.0), px(8.0)), text(15.0, INK));
            root.draw(&title)?;
            // Rows have negative y, from 0 down.
            let mut chart = ChartBuilder::on(root)
                .margin_top(px(TITLE))
                .margin_bottom(px(NOTE))
                .margin_left(px(LABELS))
                .margin_right(px(WORDS))
                .x_label_area_size(px(AXIS))
                .build_cartesian_2d(BoundedAxis::from(self.range()), BoundedAxis::from(-f64::from(all)..0.0))?;
            draw_mesh(
                chart
                    .configure_mesh()
                    .disable_y_mesh()
                    .disable_y_axis()
                    .x_labels(6)
                    .x_desc(&self.x.label)
                    .x_label_formatter(&|value| (self.x.format)(*value)),
                12.0,
            )?;
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
            let style = |horizontal| text(12.0, INK).pos(Pos::new(horizontal, VPos::Center));
            for (lines, &middle) in labels.iter().zip(&middles) {
                let top = f64::from(TITLE) + middle - (lines.len() - 1) as f64 * f64::from(LINE) / 2.0;
                for (number, line) in lines.iter().enumerate() {
                    let at = (px(f64::from(LABELS) - 10.0), px(top + number as f64 * f64::from(LINE)));
                    root.draw(&Text::new(line.clone(), at, style(HPos::Right)))?;
                }
            }
            let places = std::iter::once(-16.0).chain(middles.iter().copied());
            let all_words = std::iter::once(&self.header).chain(self.rows.iter().map(|row| &row.words));
            for (place, words) in places.zip(all_words) {
                for (word, right) in words.iter().zip(COLUMNS) {
                    let at = (px(WIDTH - right), px(f64::from(TITLE) + place));
                    root.draw(&Text::new(word.clone(), at, style(HPos::Right)))?;
                }
            }
            let at = (px(12.0), px(f64::from(TITLE + all + AXIS) + 4.0));
            root.draw(&Text::new(self.note.clone(), at, text(11.0, INK)))?;
            Ok(())
        })
    }

    /// Returns the range of the axis: everything that is drawn, and a margin.
    fn range(&self) -> std::ops::Range<f64> {
        let ends = self.rows.iter().filter_map(|row| row.interval).flat_map(|(low, high)| [low, high]);
        let ends = ends.chain(self.rows.iter().map(|row| row.mean));
        let values = self.rows.iter().flat_map(|row| row.points.iter().copied()).chain(ends);
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let air = ((high - low) * 0.05).max(high.abs() * 1e-3).max(1e-6);
        (low - air)..(high + air)
    }
}
