//! Charts of named things, such as the agents of a network: a row per name, a marker per method.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::legend::{self, LegendEntry, LegendSample};
use super::lines::Axis;
use super::look::{Look, Marker, mark};
use crate::drawing::{BoundedAxis, INK, Svg, draw_mesh, pen, px, shortened, text};

const WIDTH: u32 = 860;
const LEGEND: u32 = 250;
/// Width of the names at the left.
const NAMES: u32 = 190;
const TITLE: u32 = 34;
const AXIS: u32 = 52;
const ROW: u32 = 16;
/// Largest number of characters of a name.
const LONGEST_NAME: usize = 28;

/// The values of one method, in the order of the names, and whether the thing is stuck.
pub(crate) struct Series {
    pub(crate) label: String,
    pub(crate) look: Look,
    pub(crate) values: Vec<(f64, bool)>,
}

pub(crate) struct NamedChart {
    pub(crate) title: String,
    pub(crate) x: Axis,
    /// Names from top to bottom.
    pub(crate) names: Vec<String>,
    pub(crate) series: Vec<Series>,
    /// Text under the legend.
    pub(crate) note: String,
}

impl NamedChart {
    pub(crate) fn draw(&self) -> Result<Svg> {
        let entry = |sample, label: &str| LegendEntry { sample, label: label.to_owned() };
        let series = self.series.iter().map(|series| entry(LegendSample::Mark(series.look), &series.label));
        let entries: Vec<LegendEntry> = series.chain([entry(LegendSample::Nothing, &self.note)]).collect();
        let rows = self.names.len() as u32 * ROW;
        let height = TITLE + (rows + AXIS).max(legend::height(&entries));
        Svg::draw(WIDTH, height, |root| {
            root.draw(&Text::new(self.title.clone(), (px(12), px(8)), text(15.0, INK)))?;
            let (left, right) = root.split_horizontally(px(WIDTH - LEGEND));
            legend::draw(&right.margin(px(TITLE), 0, px(6.0), 0), &entries)?;
            // Rows have negative y, from 0 down.
            let mut chart = ChartBuilder::on(&left)
                .margin_top(px(TITLE))
                .margin_bottom(px(height - TITLE - rows - AXIS))
                .margin_left(px(NAMES))
                .margin_right(px(12.0))
                .x_label_area_size(px(AXIS))
                .build_cartesian_2d(BoundedAxis::from(self.range()), BoundedAxis::from(-f64::from(rows)..0.0))?;
            let mut mesh = chart.configure_mesh();
            let format = |value: &f64| (self.x.format)(*value);
            let mesh = mesh.disable_y_mesh().disable_y_axis().x_labels(6).x_desc(&self.x.label);
            draw_mesh(mesh.x_label_formatter(&format), 12.0)?;
            let area = chart.plotting_area();
            let x = area.get_x_range();
            for (row, name) in self.names.iter().enumerate() {
                let middle = f64::from(ROW) * (row as f64 + 0.5);
                area.draw(&PathElement::new([(x.start, -middle), (x.end, -middle)], pen(INK.mix(0.13), 1)))?;
                let style = text(11.0, INK).pos(Pos::new(HPos::Right, VPos::Center));
                let at = (px(NAMES - 8), px(f64::from(TITLE) + middle));
                root.draw(&Text::new(shortened(name, LONGEST_NAME), at, style))?;
                for series in &self.series {
                    let (value, stuck) = series.values[row];
                    mark(area, (value, -middle), series.look, 8.0, true)?;
                    if stuck {
                        mark(
                            area,
                            (value, -middle),
                            Look { colour: INK, marker: Marker::Cross, ..series.look },
                            12.0,
                            true,
                        )?;
                    }
                }
            }
            Ok(())
        })
    }

    /// Returns the range of the axis: all values, and a margin.
    fn range(&self) -> std::ops::Range<f64> {
        let values = self.series.iter().flat_map(|series| series.values.iter().map(|(value, _)| *value));
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let air = ((high - low) * 0.05).max(high.abs() * 1e-3).max(1e-6);
        (low - air)..(high + air)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_the_values_are_a_chart_is_drawn() {
        for odd in [f64::MAX, f64::MIN, 1e15, 5e-324, -0.0, 0.0, f64::INFINITY, f64::NAN] {
            let series = Series { label: "a".to_owned(), look: Look::FIRST, values: vec![(odd, true), (1.0, false)] };
            let chart = NamedChart {
                title: String::new(),
                x: Axis { label: String::new(), format: |value| format!("{value:.1}") },
                names: vec!["a".repeat(100), "b".to_owned()],
                series: vec![series],
                note: String::new(),
            };
            let svg = chart.draw().unwrap().file();
            roxmltree::Document::parse(&svg).unwrap();
            assert!(svg.contains("aaa...") && svg.contains("\nb\n"), "{svg}");
        }
    }
}
