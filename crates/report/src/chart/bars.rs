//! Bar charts: a cluster per size of a scenario, a bar per method.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::legend::{self, LegendEntry, LegendSample};
use super::look::{Look, Marker, mark};
use super::{Axis, HEIGHT, LEGEND, MOST_FOR_NUMBERS, Plot, WIDTH, whisker};
use crate::drawing::{Area, BoundedAxis, INK, Svg, anchored, draw_mesh, ink_over, pen, px, text, text_width, write_at};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    /// Bars begin at 0, and those of negative values hang down from it.
    Linear,
    /// Has its ticks at powers of 2, as in the paper's charts of runtimes. Bars begin at the lower end of the axis.
    Log2,
}

pub(crate) struct Bar {
    pub(crate) label: String,
    pub(crate) look: Look,
    pub(crate) value: f64,
    pub(crate) whisker: Option<(f64, f64)>,
    /// Values of single seeds, drawn as hollow circles.
    pub(crate) points: Vec<f64>,
    pub(crate) paper: Option<f64>,
}

pub(crate) struct Cluster {
    pub(crate) label: String,
    pub(crate) bars: Vec<Bar>,
}

pub(crate) struct BarChart {
    pub(crate) title: String,
    pub(crate) y: Axis,
    /// Format of the numbers on the bars.
    pub(crate) format: fn(f64) -> String,
    pub(crate) scale: Scale,
    pub(crate) clusters: Vec<Cluster>,
    pub(crate) note: String,
}

impl Bar {
    fn of_paper(&self) -> Look {
        Look { colour: INK, marker: Marker::Diamond, ..self.look }
    }
}

impl BarChart {
    pub(crate) fn draw(&self) -> Result<Svg> {
        let entries = self.legend();
        let height = HEIGHT.max(legend::height(&entries) + 40);
        let (low, high) = self.range();
        let [low, high] = [low, high].map(|end| self.place(end));
        Svg::draw(WIDTH, height, |root| {
            let (plot, right) = root.split_horizontally(px(WIDTH - LEGEND));
            legend::draw(&right.margin(px(34), 0, px(6), 0), &entries)?;
            let (axis, ends) = match self.scale {
                Scale::Linear => (BoundedAxis::from(low..high), [low, high]),
                Scale::Log2 => (BoundedAxis::of_whole_numbers(low..high), [low.ceil(), high.floor()]),
            };
            let y_format = |place: &f64| match self.scale {
                Scale::Linear => (self.y.format)(*place),
                Scale::Log2 => (self.y.format)(place.exp2()),
            };
            let widest = ends.map(|end| text_width(&y_format(&end), 12.0)).into_iter().max();
            let mut chart = ChartBuilder::on(&plot)
                .caption(&self.title, text(15.0, INK))
                .margin(px(8))
                .x_label_area_size(px(42))
                .y_label_area_size((widest.unwrap_or(0) + px(30)).min(px(MOST_FOR_NUMBERS)))
                .build_cartesian_2d(BoundedAxis::from(0.0..self.clusters.len() as f64), axis)?;
            let mut mesh = chart.configure_mesh();
            let mesh = mesh.disable_x_mesh().x_labels(0).y_labels(8).x_desc("agents").y_desc(&self.y.label);
            draw_mesh(mesh.y_label_formatter(&y_format), 12.0)?;
            let area = chart.plotting_area();
            if self.scale == Scale::Linear && low < 0.0 {
                let zero = vec![(0.0, 0.0), (self.clusters.len() as f64, 0.0)];
                area.draw(&PathElement::new(zero, pen(INK, 1)))?;
            }
            for (index, cluster) in self.clusters.iter().enumerate() {
                let foot = area.map_coordinate(&(index as f64 + 0.5, low));
                write_at(root, &cluster.label, (foot.0, foot.1 + px(8)), 12, (HPos::Center, VPos::Top))?;
                let size = if cluster.bars.len() * self.clusters.len() > 12 { 9.0 } else { 11.0 };
                let width = 0.8 / cluster.bars.len().max(1) as f64;
                for (place, bar) in cluster.bars.iter().enumerate() {
                    let left = index as f64 + 0.1 + place as f64 * width;
                    let middle = left + width / 2.0;
                    self.draw_bar((root, area), bar, [left, width, low, size])?;
                    self.draw_spread(area, bar, (middle, low))?;
                    if let Some(paper) = bar.paper {
                        mark(area, (middle, self.place(paper)), bar.of_paper(), 10.0, false)?;
                    }
                }
            }
            Ok(())
        })
    }

    /// Returns where on the axis a value stands.
    fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => value,
            Scale::Log2 => value.log2(),
        }
    }

    fn bars(&self) -> impl Iterator<Item = &Bar> {
        self.clusters.iter().flat_map(|cluster| &cluster.bars)
    }

    fn legend(&self) -> Vec<LegendEntry> {
        let mut entries: Vec<LegendEntry> = Vec::new();
        for bar in self.bars() {
            if entries.iter().all(|entry| entry.label != bar.label) {
                entries.push(LegendEntry::new(LegendSample::Bar(bar.look), &bar.label));
            }
        }
        let of_paper = self.bars().find(|bar| bar.paper.is_some());
        entries.extend(of_paper.map(|bar| LegendEntry::new(LegendSample::Hollow(bar.of_paper()), "the paper")));
        entries.extend(LegendEntry::of_note(&self.note));
        entries
    }

    fn range(&self) -> (f64, f64) {
        let values = || {
            self.bars().flat_map(|bar| {
                let whisker = bar.whisker.map(|(_, to)| to);
                [bar.value].into_iter().chain(bar.paper).chain(whisker).chain(bar.points.iter().copied())
            })
        };
        let high = values().fold(f64::MIN_POSITIVE, f64::max);
        match self.scale {
            Scale::Linear => {
                let whiskers = self.bars().filter_map(|bar| Some(bar.whisker?.0));
                let low = values().chain(whiskers).fold(0.0, f64::min);
                // The number of a low bar stands beyond its end.
                let air = 0.1 * (high - low);
                (if low < 0.0 { low - air } else { 0.0 }, if high > f64::MIN_POSITIVE { high + air } else { air })
            }
            Scale::Log2 => {
                let low = values().filter(|&value| value > 0.0).fold(high, f64::min);
                ((low / 2.0).log2().floor().exp2(), high * 1.6)
            }
        }
    }

    /// `places`: left end and width of the bar in clusters, lower end of the axis, and size of the number in pixels.
    fn draw_bar(&self, (root, area): (&Area, &Plot), bar: &Bar, places: [f64; 4]) -> Result<()> {
        let [left, width, low, size] = places;
        let begin = if self.scale == Scale::Linear { 0.0 } else { low };
        let corners = [(left + 0.05 * width, begin), (left + 0.95 * width, self.place(bar.value))];
        area.draw(&Rectangle::new(corners, bar.look.colour.filled()))?;
        // The marker at its foot identifies the bar in black and white.
        let over = ink_over(bar.look.colour);
        let middle = left + width / 2.0;
        let foot = area.map_coordinate(&(middle, begin));
        let rise = foot.1 - area.map_coordinate(&(middle, self.place(bar.value))).1;
        let (tall, away) = (rise.abs(), if rise < 0 { 1 } else { -1 });
        if tall > px(20) {
            let within = (foot.0, foot.1 + away * px(12));
            mark(root, within, Look { colour: over, ..bar.look }, 9.0, true)?;
        }
        let words = (self.format)(bar.value);
        let end = |x| area.map_coordinate(&(x, begin)).0;
        let room = end(left + width) - end(left);
        let (turn, far, inside) = place_of_number(text_width(&words, size), room, tall);
        let style = text(size, if inside { over } else { INK }).transform(turn);
        Ok(root.draw_text(&words, &anchored(style, HPos::Center, VPos::Center), (foot.0, foot.1 + away * far))?)
    }

    fn draw_spread(&self, area: &Plot, bar: &Bar, (x, low): (f64, f64)) -> Result<()> {
        if let Some((from, to)) = bar.whisker {
            // No whisker goes below the axis.
            whisker(area, x, (self.place(from).max(low), self.place(to)), INK)?;
        }
        for &point in &bar.points {
            // Dark on white is visible on the bar and above it.
            let circle = |colour| Look { colour, marker: Marker::Circle, ..bar.look };
            mark(area, (x, self.place(point)), circle(WHITE), 7.0, true)?;
            mark(area, (x, self.place(point)), circle(INK), 6.0, false)?;
        }
        Ok(())
    }
}

/// Returns how the number of a bar is turned, the distance of its middle from the bar's foot, and whether it is inside.
/// `long`: length of the number; `room`: width from bar to bar; `tall`: height of the bar; all in pixels.
fn place_of_number(long: i32, room: i32, tall: i32) -> (FontTransform, i32, bool) {
    let (turn, high) = match long + px(2) > room {
        true => (FontTransform::Rotate270, long),
        false => (FontTransform::None, px(16)),
    };
    // Below it is the marker at the foot.
    let below = px(22);
    match tall > below + high {
        true => (turn, below + high / 2, true),
        false => (turn, tall + high / 2, false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_of_negative_returns_hang_from_0_within_the_axis() {
        let bar = |value: f64| Bar {
            label: String::new(),
            look: Look::FIRST,
            value,
            whisker: Some((value - 2.0, value + 2.0)),
            points: Vec::new(),
            paper: None,
        };
        let range = |values: &[f64]| {
            let [label, title, note] = [const { String::new() }; 3];
            let clusters = vec![Cluster { label, bars: values.iter().map(|&value| bar(value)).collect() }];
            let format = |value| format!("{value:.1}");
            let y = Axis { label: String::new(), format };
            BarChart { title, y, format, scale: Scale::Linear, clusters, note }.range()
        };
        // A tenth of the 18 or 20 units beyond each end.
        assert_eq!(range(&[-14.0, -4.0]), (-17.6, 1.6));
        assert_eq!(range(&[8.0]), (0.0, 11.0));
        assert_eq!(range(&[-8.0, 8.0]), (-12.0, 12.0));
    }

    #[test]
    fn a_number_stands_upright_in_a_narrow_bar_and_above_a_low_one() {
        let place = |long, room, tall| {
            let (turn, far, inside) = place_of_number(px(long), px(room), px(tall));
            (matches!(turn, FontTransform::Rotate270), far, inside)
        };
        // Lying, it is 16 high and stands on the 22 of the marker: 22 + 16 / 2.
        assert_eq!(place(30.0, 36.0, 200.0), (false, px(30), true));
        // Upright, it is as high as it is long: 22 + 30 / 2.
        assert_eq!(place(30.0, 20.0, 200.0), (true, px(37), true));
        // A bar of 40 has room for the number that lies, not for the upright one.
        assert!(place(30.0, 36.0, 40.0).2);
        assert_eq!(place(30.0, 20.0, 40.0), (true, px(55), false));
    }
}
