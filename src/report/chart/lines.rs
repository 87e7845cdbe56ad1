//! Lines over a common axis, with bands, whiskers, levels and points from elsewhere.

use anyhow::Result;
use plotters::coord::CoordTranslate;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::legend::{self, Entry, Sample};
use super::look::{Dash, Look, mark, stroke};
use super::{INK, Svg, failed, px, text, text_width};

const WIDTH: u32 = 860;
const HEIGHT: u32 = 400;
const LEGEND: u32 = 250;
/// Places along the axis at which a line shows its marker.
const MARKERS: usize = 8;

/// What is measured along an axis, and how its numbers are written.
pub struct Axis {
    pub label: String,
    pub format: fn(f64) -> String,
}

#[derive(Clone, Copy, Debug)]
pub struct LinePoint {
    pub x: f64,
    pub y: f64,
    /// Shaded around the line.
    pub band: Option<(f64, f64)>,
    /// Drawn at the markers.
    pub whisker: Option<(f64, f64)>,
    /// Whether all runs are in it; where not the line is thin.
    pub whole: bool,
}

pub struct Line {
    pub label: String,
    pub look: Look,
    pub points: Vec<LinePoint>,
    /// A thin line that belongs to it, named once for all lines.
    pub companion: Vec<(f64, f64)>,
}

/// A line across the chart.
pub struct Level {
    pub label: String,
    pub y: f64,
    /// Dashed where it was measured here, dotted where it is from elsewhere.
    pub measured: bool,
}

/// Points from elsewhere. Nothing joins them: nobody knows what is between.
pub struct Mark {
    pub label: String,
    pub look: Look,
    /// x, y and the standard error.
    pub points: Vec<(f64, f64, Option<f64>)>,
}

pub struct LineChart {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub lines: Vec<Line>,
    /// What the companions are.
    pub companions: Option<String>,
    pub levels: Vec<Level>,
    pub marks: Vec<Mark>,
    /// To where the x axis goes, if no point goes further.
    pub x_end: f64,
    /// Told under the legend.
    pub note: String,
}

impl LineChart {
    pub fn draw(&self) -> Result<Svg> {
        let entries = self.legend();
        let height = HEIGHT.max(legend::height(&entries) + 40);
        Svg::draw(WIDTH, height, |root| {
            let (plot, right) = root.split_horizontally(px(f64::from(WIDTH - LEGEND)));
            let right = right.margin(px(34.0), 0, px(6.0), 0);
            legend::draw(&right, &entries)?;
            let (x, y) = self.ranges();
            let mut chart = ChartBuilder::on(&plot)
                .caption(&self.title, text(15.0, INK))
                .margin(px(8.0))
                .x_label_area_size(px(42.0))
                .y_label_area_size(px(self.label_width(&y)))
                .build_cartesian_2d(x, y)
                .map_err(failed)?;
            chart
                .configure_mesh()
                .x_labels(7)
                .y_labels(7)
                .x_desc(&self.x.label)
                .y_desc(&self.y.label)
                .x_label_formatter(&|value| (self.x.format)(*value))
                .y_label_formatter(&|value| (self.y.format)(*value))
                .label_style(text(12.0, INK))
                .axis_desc_style(text(13.0, INK))
                .axis_style(ShapeStyle { color: INK.to_rgba(), filled: false, stroke_width: px(1.0) as u32 })
                .bold_line_style(ShapeStyle { color: INK.mix(0.13), filled: false, stroke_width: px(1.0) as u32 })
                .light_line_style(TRANSPARENT)
                .set_all_tick_mark_size(px(4.0))
                .draw()
                .map_err(failed)?;
            let area = chart.plotting_area();
            let x_end = area.get_x_range().end;
            for level in &self.levels {
                let points = vec![(area.get_x_range().start, level.y), (x_end, level.y)];
                stroke(area, points, (INK.to_rgba(), level_dash(level)), 1.5)?;
            }
            for line in &self.lines {
                let low = line.points.iter().filter_map(|point| Some((point.x, point.band?.0)));
                let high = line.points.iter().filter_map(|point| Some((point.x, point.band?.1)));
                let rim: Vec<(f64, f64)> = high.chain(low.rev()).collect();
                if !rim.is_empty() {
                    area.draw(&Polygon::new(rim, line.look.colour.mix(0.22).filled())).map_err(failed)?;
                }
            }
            for points in &self.marks {
                for &(x, y, std_error) in &points.points {
                    if let Some(error) = std_error {
                        whisker(area, x, (y - error, y + error), points.look.colour)?;
                    }
                    mark(area, (x, y), points.look, 9.0, false)?;
                }
            }
            for (index, line) in self.lines.iter().enumerate() {
                self.draw_line(area, index, line)?;
            }
            Ok(())
        })
    }

    fn draw_line<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
        index: usize,
        line: &Line,
    ) -> Result<()>
    where
        DB::ErrorType: 'static,
    {
        let colour = line.look.colour;
        stroke(area, line.companion.clone(), (colour.to_rgba(), Dash::Dotted), 1.0)?;
        // Where runs are missing the line is thin; both parts share the point between them.
        let whole = line.points.iter().take_while(|point| point.whole).count();
        let places = |points: &[LinePoint]| points.iter().map(|point| (point.x, point.y)).collect::<Vec<_>>();
        stroke(area, places(&line.points[..whole]), (colour.to_rgba(), line.look.dash), 2.0)?;
        stroke(area, places(&line.points[whole.saturating_sub(1)..]), (colour.to_rgba(), line.look.dash), 0.8)?;
        // Each line has its markers at other places.
        let every = line.points.len().div_ceil(MARKERS).max(1);
        for point in line.points.iter().skip(index % every).step_by(every) {
            if let Some(ends) = point.whisker {
                whisker(area, point.x, ends, colour)?;
            }
            mark(area, (point.x, point.y), line.look, 7.0, true)?;
        }
        Ok(())
    }

    fn legend(&self) -> Vec<Entry> {
        // As the lines end, from top to bottom.
        let mut lines: Vec<&Line> = self.lines.iter().collect();
        let end = |line: &Line| line.points.last().map_or(f64::NEG_INFINITY, |point| point.y);
        lines.sort_by(|a, b| end(b).total_cmp(&end(a)));
        let lines = lines.into_iter().map(|line| Entry { sample: Sample::Curve(line.look), label: line.label.clone() });
        let companions = self
            .companions
            .iter()
            .map(|label| Entry { sample: Sample::Level(INK, Dash::Dotted), label: label.clone() });
        let levels = self
            .levels
            .iter()
            .map(|level| Entry { sample: Sample::Level(INK, level_dash(level)), label: level.label.clone() });
        let marks =
            self.marks.iter().map(|mark| Entry { sample: Sample::Hollow(mark.look), label: mark.label.clone() });
        let note = (!self.note.is_empty()).then(|| Entry { sample: Sample::Nothing, label: self.note.clone() });
        lines.chain(companions).chain(levels).chain(marks).chain(note).collect()
    }

    /// What the axes span: all that is drawn, and some air.
    fn ranges(&self) -> (std::ops::Range<f64>, std::ops::Range<f64>) {
        let points = || self.lines.iter().flat_map(|line| &line.points);
        let marks = || self.marks.iter().flat_map(|mark| &mark.points);
        let xs = points().map(|point| point.x).chain(marks().map(|mark| mark.0));
        let bands =
            points().flat_map(|point| [point.band, point.whisker]).flatten().flat_map(|(low, high)| [low, high]);
        let ys = points()
            .map(|point| point.y)
            .chain(bands)
            .chain(self.lines.iter().flat_map(|line| line.companion.iter().map(|point| point.1)))
            .chain(self.levels.iter().map(|level| level.y))
            .chain(marks().flat_map(|&(_, y, error)| [y - error.unwrap_or(0.0), y + error.unwrap_or(0.0)]));
        let right = xs.fold(self.x_end, f64::max).max(f64::MIN_POSITIVE);
        let (low, high) = ys.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
        let (low, high) = if low.is_finite() { (low, high) } else { (0.0, 1.0) };
        let air = ((high - low) * 0.05).max(high.abs() * 1e-3).max(1e-6);
        (0.0..right * 1.015, (low - air)..(high + air))
    }

    /// Pixels for the numbers of the y axis and its label.
    fn label_width(&self, y: &std::ops::Range<f64>) -> f64 {
        let widest = [y.start, y.end].map(|value| text_width(&(self.y.format)(value), 12.0)).into_iter().max();
        f64::from(widest.unwrap_or(0)) / f64::from(super::SCALE) + 30.0
    }
}

fn level_dash(level: &Level) -> Dash {
    if level.measured { Dash::Dashed } else { Dash::Dotted }
}

/// A vertical bar with two feet.
pub fn whisker<DB, CT, X>(area: &DrawingArea<DB, CT>, x: X, (low, high): (f64, f64), colour: RGBColor) -> Result<()>
where
    DB: DrawingBackend,
    DB::ErrorType: 'static,
    X: Clone + 'static,
    CT: CoordTranslate<From = (X, f64)>,
{
    let style = ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: px(1.2) as u32 };
    area.draw(&PathElement::new(vec![(x.clone(), low), (x.clone(), high)], style)).map_err(failed)?;
    for end in [low, high] {
        let foot = PathElement::new(vec![(-px(3.0), 0), (px(3.0), 0)], style);
        area.draw(&(EmptyElement::at((x.clone(), end)) + foot)).map_err(failed)?;
    }
    Ok(())
}
