//! Bar charts: a cluster per size of a scenario, a bar per method.

use std::ops::Range;

use anyhow::Result;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::legend::{self, LegendEntry, LegendSample};
use super::lines::{Axis, MOST_FOR_NUMBERS, whisker};
use super::look::{Look, Marker, mark};
use crate::drawing::{Area, BoundedAxis, INK, Svg, draw_mesh, ink_over, pen, px, text, text_width};

const WIDTH: u32 = 860;
const HEIGHT: u32 = 400;
const LEGEND: u32 = 250;
/// Largest number of ticks at powers of 2.
const MOST_POWERS: usize = 32;

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
    pub(crate) value: Option<f64>,
    pub(crate) whisker: Option<(f64, f64)>,
    /// Values of single seeds, drawn as hollow circles.
    pub(crate) points: Vec<f64>,
    /// The paper's value.
    pub(crate) paper: Option<f64>,
}

pub(crate) struct Cluster {
    pub(crate) label: String,
    pub(crate) bars: Vec<Bar>,
}

pub(crate) struct BarChart {
    pub(crate) title: String,
    pub(crate) x_label: String,
    pub(crate) y: Axis,
    /// Format of the numbers on the bars.
    pub(crate) format: fn(f64) -> String,
    pub(crate) scale: Scale,
    pub(crate) clusters: Vec<Cluster>,
    pub(crate) note: String,
}

impl Scale {
    /// Returns where on the axis a value stands.
    fn place(self, value: f64) -> f64 {
        match self {
            Scale::Linear => value,
            Scale::Log2 => value.log2(),
        }
    }

    /// Returns the value that stands here on the axis.
    fn value(self, place: f64) -> f64 {
        match self {
            Scale::Linear => place,
            Scale::Log2 => place.exp2(),
        }
    }
}

impl BarChart {
    pub(crate) fn draw(&self) -> Result<Svg> {
        let entries = self.legend();
        let height = HEIGHT.max(legend::height(&entries) + 40);
        let (low, high) = self.range();
        let [low, high] = [low, high].map(|end| self.scale.place(end));
        Svg::draw(WIDTH, height, |root| {
            let (plot, right) = root.split_horizontally(px(WIDTH - LEGEND));
            legend::draw(&right.margin(px(34.0), 0, px(6.0), 0), &entries)?;
            let y_format = |place: &f64| (self.y.format)(self.scale.value(*place));
            let ends = match self.scale {
                Scale::Linear => [low, high],
                Scale::Log2 => [low.ceil(), high.floor()],
            };
            let widest = ends.map(|end| text_width(&y_format(&end), 12.0)).into_iter().max();
            let mut chart = ChartBuilder::on(&plot)
                .caption(&self.title, text(15.0, INK))
                .margin(px(8.0))
                .x_label_area_size(px(42.0))
                .y_label_area_size((widest.unwrap_or(0) + px(30.0)).min(px(MOST_FOR_NUMBERS)))
                .build_cartesian_2d(
                    BoundedAxis::from(0.0..self.clusters.len() as f64),
                    Ticked::new(low..high, self.scale),
                )?;
            draw_mesh(
                chart
                    .configure_mesh()
                    .disable_x_mesh()
                    .x_labels(0)
                    .y_labels(8)
                    .x_desc(&self.x_label)
                    .y_desc(&self.y.label)
                    .y_label_formatter(&y_format),
                12.0,
            )?;
            let bars = Bars { chart: self, root, plot: chart.plotting_area(), low };
            if self.scale == Scale::Linear && low < 0.0 {
                bars.draw_zero()?;
            }
            self.clusters.iter().enumerate().try_for_each(|(index, cluster)| bars.draw_cluster(index, cluster))
        })
    }

    fn legend(&self) -> Vec<LegendEntry> {
        let mut entries: Vec<LegendEntry> = Vec::new();
        let bars = || self.clusters.iter().flat_map(|cluster| &cluster.bars);
        for bar in bars() {
            if entries.iter().all(|entry| entry.label != bar.label) {
                entries.push(LegendEntry { sample: LegendSample::Bar(bar.look), label: bar.label.clone() });
            }
        }
        if let Some(bar) = bars().find(|bar| bar.paper.is_some()) {
            let look = Look { colour: INK, marker: Marker::Diamond, ..bar.look };
            entries.push(LegendEntry { sample: LegendSample::Hollow(look), label: "the paper".to_owned() });
        }
        if !self.note.is_empty() {
            entries.push(LegendEntry { sample: LegendSample::Nothing, label: self.note.clone() });
        }
        entries
    }

    fn range(&self) -> (f64, f64) {
        let bars = || self.clusters.iter().flat_map(|cluster| &cluster.bars);
        let values = || {
            bars().flat_map(|bar| {
                [bar.value, bar.paper, bar.whisker.map(|(_, to)| to)]
                    .into_iter()
                    .flatten()
                    .chain(bar.points.iter().copied())
            })
        };
        let high = values().fold(f64::MIN_POSITIVE, f64::max);
        match self.scale {
            Scale::Linear => {
                let whiskers = bars().filter_map(|bar| Some(bar.whisker?.0));
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
}

/// The bars of a chart, and where they are drawn.
struct Bars<'a, 'b> {
    chart: &'a BarChart,
    /// The whole picture, in pixels.
    root: &'a Area<'b>,
    /// The plot: a cluster is 1 wide.
    plot: &'a DrawingArea<SVGBackend<'b>, Cartesian2d<BoundedAxis, Ticked>>,
    /// Lower end of the axis.
    low: f64,
}

/// Where in the plot a bar stands, and the size of its number in pixels.
#[derive(Clone, Copy)]
struct Slot {
    left: f64,
    width: f64,
    number: f64,
}

impl Slot {
    fn middle(self) -> f64 {
        self.left + self.width / 2.0
    }
}

impl Bars<'_, '_> {
    fn draw_zero(&self) -> Result<()> {
        let zero = vec![(0.0, 0.0), (self.chart.clusters.len() as f64, 0.0)];
        Ok(self.plot.draw(&PathElement::new(zero, pen(INK, 1)))?)
    }

    fn draw_cluster(&self, index: usize, cluster: &Cluster) -> Result<()> {
        let below = Pos::new(HPos::Center, VPos::Top);
        let label = Text::new(cluster.label.clone(), (0, px(8.0)), text(12.0, INK).pos(below));
        let foot = self.plot.map_coordinate(&(index as f64 + 0.5, self.low));
        self.root.draw(&(EmptyElement::at(foot) + label))?;
        let number = if cluster.bars.len() * self.chart.clusters.len() > 12 { 9.0 } else { 11.0 };
        let width = 0.8 / cluster.bars.len().max(1) as f64;
        for (place, bar) in cluster.bars.iter().enumerate() {
            let slot = Slot { left: index as f64 + 0.1 + place as f64 * width, width, number };
            if let Some(value) = bar.value {
                self.draw_value(bar, value, slot)?;
                self.draw_spread(bar, slot)?;
            }
            if let Some(paper) = bar.paper {
                let hollow = Look { colour: INK, marker: Marker::Diamond, ..bar.look };
                mark(self.plot, (slot.middle(), self.chart.scale.place(paper)), hollow, 10.0, false)?;
            }
        }
        Ok(())
    }

    /// Draws the bar itself, its marker and its number.
    fn draw_value(&self, bar: &Bar, value: f64, slot: Slot) -> Result<()> {
        let scale = self.chart.scale;
        let Slot { left, width, number } = slot;
        let begin = if scale == Scale::Linear { 0.0 } else { self.low };
        let corners = [(left + 0.05 * width, begin), (left + 0.95 * width, scale.place(value))];
        self.plot.draw(&Rectangle::new(corners, bar.look.colour.filled()))?;
        // The marker at its foot identifies the bar in black and white.
        let over = ink_over(bar.look.colour);
        let foot = self.plot.map_coordinate(&(slot.middle(), begin));
        let rise = foot.1 - self.plot.map_coordinate(&(slot.middle(), scale.place(value))).1;
        let (tall, away) = (rise.abs(), if rise < 0 { 1 } else { -1 });
        if tall > px(20.0) {
            let within = (foot.0, foot.1 + away * px(12.0));
            mark(self.root, within, Look { colour: over, ..bar.look }, 9.0, true)?;
        }
        let words = (self.chart.format)(value);
        let end = |x| self.plot.map_coordinate(&(x, begin)).0;
        let room = end(left + width) - end(left);
        let (turn, far, inside) = place_of_number(text_width(&words, number), room, tall);
        let style = text(number, if inside { over } else { INK });
        let style = style.transform(turn).pos(Pos::new(HPos::Center, VPos::Center));
        Ok(self.root.draw(&Text::new(words, (foot.0, foot.1 + away * far), style))?)
    }

    /// Draws the whisker and the values of single seeds.
    fn draw_spread(&self, bar: &Bar, slot: Slot) -> Result<()> {
        let (place, x) = (|value| self.chart.scale.place(value), slot.middle());
        if let Some((from, to)) = bar.whisker {
            // No whisker goes below the axis.
            let from = place(from).max(self.low);
            whisker(self.plot, x, (from, place(to)), INK)?;
        }
        for &point in &bar.points {
            // Dark on white is visible on the bar and above it.
            let circle = |colour| Look { colour, marker: Marker::Circle, ..bar.look };
            mark(self.plot, (x, place(point)), circle(WHITE), 7.0, true)?;
            mark(self.plot, (x, place(point)), circle(INK), 6.0, false)?;
        }
        Ok(())
    }
}

/// An axis with its ticks at whole powers of 2 if the scale is [`Scale::Log2`].
struct Ticked {
    axis: BoundedAxis,
    scale: Scale,
}

impl Ticked {
    fn new(range: Range<f64>, scale: Scale) -> Self {
        Ticked { axis: BoundedAxis::from(range), scale }
    }
}

impl Ranged for Ticked {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.axis.map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let Range { start, end } = self.axis.range();
        match self.scale {
            Scale::Linear => self.axis.key_points(hint),
            Scale::Log2 => {
                let powers = start.ceil() as i32..=end.floor() as i32;
                let every = powers.clone().count().div_ceil(MOST_POWERS).max(1);
                powers.step_by(every).map(f64::from).collect()
            }
        }
    }

    fn range(&self) -> Range<f64> {
        self.axis.range()
    }
}

/// Returns how the number of a bar is turned, the distance of its middle from the bar's foot, and whether it is inside.
///
/// `long`: length of the number; `room`: width from bar to bar; `tall`: height of the bar; all in pixels. In a narrow bar
/// the number stands upright, so that it does not reach into the next one.
fn place_of_number(long: i32, room: i32, tall: i32) -> (FontTransform, i32, bool) {
    let (turn, high) = match long + px(2.0) > room {
        true => (FontTransform::Rotate270, long),
        false => (FontTransform::None, px(16.0)),
    };
    // Below it is the marker at the foot.
    let below = px(22.0);
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
            value: Some(value),
            whisker: Some((value - 2.0, value + 2.0)),
            points: Vec::new(),
            paper: None,
        };
        let range = |values: &[f64]| {
            let clusters =
                vec![Cluster { label: String::new(), bars: values.iter().map(|&value| bar(value)).collect() }];
            let axis = || Axis { label: String::new(), format: |value| format!("{value:.1}") };
            let [title, x_label, note] = [const { String::new() }; 3];
            BarChart { title, x_label, y: axis(), format: |_| String::new(), scale: Scale::Linear, clusters, note }
                .range()
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
        assert_eq!(place(30.0, 36.0, 200.0), (false, px(30.0), true));
        // Upright, it is as high as it is long: 22 + 30 / 2.
        assert_eq!(place(30.0, 20.0, 200.0), (true, px(37.0), true));
        // A bar of 40 has room for the number that lies, not for the upright one.
        assert!(place(30.0, 36.0, 40.0).2);
        assert_eq!(place(30.0, 20.0, 40.0), (true, px(55.0), false));
    }

    #[test]
    fn whatever_the_values_are_a_chart_is_drawn() {
        let odd = [f64::MAX, f64::MIN, 1e300, -1e300, 5e-324, -0.0, 0.0, 1.0, -3.0, f64::INFINITY, f64::NAN];
        for scale in [Scale::Linear, Scale::Log2] {
            for first in odd {
                for second in odd {
                    let bar = |value: f64| Bar {
                        label: "a".to_owned(),
                        look: Look::FIRST,
                        value: Some(value),
                        whisker: Some((second, first)),
                        points: vec![first, second],
                        paper: Some(second),
                    };
                    let chart = BarChart {
                        title: String::new(),
                        x_label: String::new(),
                        y: Axis { label: String::new(), format: |value| format!("{value:.1}") },
                        format: |value| format!("{value:.1}"),
                        scale,
                        clusters: vec![Cluster { label: "4".to_owned(), bars: vec![bar(first), bar(second)] }],
                        note: String::new(),
                    };
                    let svg = chart.draw().unwrap().file();
                    roxmltree::Document::parse(&svg).unwrap();
                }
            }
        }
    }
}
