//! Line charts with bands, single seeds, levels and points from the paper.

use std::ops::Range;

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::legend::{self, LegendEntry, LegendSample};
use super::look::{Dash, Look, Marker, mark, stroke};
use super::{Axis, HEIGHT, LEGEND, MOST_FOR_NUMBERS, Plot, WIDTH, whisker, with_air};
use crate::drawing::{
    Area, BoundedAxis, INK, SCALE, Svg, anchored, draw_mesh, ends_of, px, text, text_width, write, write_at,
};

const MARKERS: usize = 8;
/// Largest number of lines in a chart with bands and seeds: of more, a reader could not see what belongs to which.
pub(crate) const MOST_BANDS: usize = 5;
const COLUMNS: usize = 3;
const PANEL: u32 = 190;
const PANEL_WRAP: usize = 44;
const PANEL_LINE: u32 = 14;

#[derive(Clone, Copy, Debug)]
pub(crate) struct LinePoint {
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Interval around the mean, drawn as a shaded band.
    pub(crate) band: Option<(f64, f64)>,
    /// Whether all runs count at this point. If not, the line is thin here.
    pub(crate) whole: bool,
}

#[derive(Clone)]
pub(crate) struct Line {
    pub(crate) label: String,
    pub(crate) look: Look,
    pub(crate) points: Vec<LinePoint>,
    /// Thin dotted line that belongs to this one, such as the median agent. The legend has one entry for all of them.
    pub(crate) companion: Vec<(f64, f64)>,
    /// Curves of single seeds, drawn as pale lines.
    pub(crate) seeds: Vec<Vec<(f64, f64)>>,
}

/// A horizontal line across the chart.
#[derive(Clone)]
pub(crate) struct Level {
    pub(crate) label: String,
    /// Short name, written at its right end.
    pub(crate) name: String,
    pub(crate) y: f64,
    /// Whether it was measured here (short dashes) or is from the paper (long dashes).
    pub(crate) measured: bool,
}

/// Single points, such as the paper's. No line joins them, because the values between them are not known.
#[derive(Clone)]
pub(crate) struct Mark {
    pub(crate) label: String,
    pub(crate) look: Look,
    /// x, y, and the standard error of y if it is known.
    pub(crate) points: Vec<(f64, f64, Option<f64>)>,
}

#[derive(Clone)]
pub(crate) struct LineChart {
    pub(crate) title: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) lines: Vec<Line>,
    /// Label of the companions; `None` if the chart has no entry for them.
    pub(crate) companions: Option<String>,
    pub(crate) levels: Vec<Level>,
    pub(crate) marks: Vec<Mark>,
    /// Smallest right end of the x axis. Points beyond it extend the axis.
    pub(crate) x_end: f64,
    pub(crate) note: String,
}

type Ranges = (Range<f64>, Range<f64>);

#[derive(Clone, Copy)]
struct Size {
    numbers: f64,
    names: f64,
    /// Space for these names at the right, in pixels.
    right: f64,
    ticks: usize,
    axis_titles: bool,
}

const WHOLE: Size = Size { numbers: 12.0, names: 11.0, right: 76.0, ticks: 7, axis_titles: true };
const SMALL: Size = Size { numbers: 10.0, names: 9.0, right: 60.0, ticks: 4, axis_titles: false };

const OF_REFERENCE: Look = Look { colour: INK, dash: Dash::Dashed, marker: Marker::Square };

fn of_other(line: &Line) -> Look {
    Look { colour: line.look.colour, ..Look::FIRST }
}

impl LineChart {
    pub(crate) fn draw(&self) -> Result<Svg> {
        // In the order of the lines' right ends, from top to bottom.
        let mut lines: Vec<&Line> = self.lines.iter().collect();
        let end = |line: &Line| line.points.last().map_or(f64::NEG_INFINITY, |point| point.y);
        lines.sort_by(|a, b| end(b).total_cmp(&end(a)));
        let lines = lines.into_iter().map(|line| LegendEntry::new(LegendSample::Curve(line.look), &line.label));
        let entries: Vec<LegendEntry> = lines.chain(self.legend_of_the_rest()).collect();
        let height = HEIGHT.max(legend::height(&entries) + 40);
        Svg::draw(WIDTH, height, |root| {
            let (plot, right) = root.split_horizontally(px(WIDTH - LEGEND));
            legend::draw(&right.margin(px(34), 0, px(6), 0), &entries)?;
            let middle = px(f64::from(WIDTH - LEGEND) / 2.0);
            write_at(&plot, &self.title, (middle, px(8)), 15, (HPos::Center, VPos::Top))?;
            self.plot(&plot.margin(px(26), 0, 0, 0), self.ranges(), WHOLE)
        })
    }

    /// Draws a panel for each line except the reference, which is in all of them.
    pub(crate) fn draw_against(&self, reference: usize) -> Result<Svg> {
        let reference = &self.lines[reference];
        let others: Vec<&Line> = self.lines.iter().filter(|line| !std::ptr::eq(*line, reference)).collect();
        let panels: Vec<(LineChart, Vec<String>)> = others
            .iter()
            .map(|line| (self.panel(line, reference), legend::in_lines(&line.label, PANEL_WRAP)))
            .collect();
        let title_height = |row: &[(LineChart, Vec<String>)]| {
            row.iter().map(|(_, title)| title.len()).max().unwrap_or(1) as u32 * PANEL_LINE + 8
        };
        let grid_height: u32 = panels.chunks(COLUMNS).map(|row| title_height(row) + PANEL).sum();
        let entries = self.legend_against(reference, others.first().map_or(Look::FIRST, |line| of_other(line)));
        let legend_columns: Vec<&[LegendEntry]> = entries.chunks(entries.len().div_ceil(COLUMNS).max(1)).collect();
        let legend_height = legend_columns.iter().map(|entries| legend::height(entries)).max().unwrap_or(0);
        let title = format!("{}: {}, by {}", self.title, self.y.label, self.x.label);
        Svg::draw(WIDTH, 30 + grid_height + legend_height, |root| {
            write(root, &title, (px(12), px(8)), 15)?;
            let (_, mut below) = root.split_vertically(px(30));
            for panels in panels.chunks(COLUMNS) {
                let (row, rest) = below.split_vertically(px(title_height(panels) + PANEL));
                below = rest;
                for ((panel, title), area) in panels.iter().zip(row.split_evenly((1, COLUMNS))) {
                    let (above, plot) = area.split_vertically(px(title_height(panels)));
                    for (number, line) in title.iter().enumerate() {
                        write(&above, line, (px(14), px(8 + number as u32 * PANEL_LINE)), 11.5)?;
                    }
                    panel.plot(&plot, self.ranges(), SMALL)?;
                }
            }
            for (entries, area) in legend_columns.iter().zip(below.split_evenly((1, COLUMNS))) {
                legend::draw(&area.margin(px(4), 0, px(10), 0), entries)?;
            }
            Ok(())
        })
    }

    /// Returns the panel of a line. Only its own marks and those of the reference are in it.
    fn panel(&self, line: &Line, reference: &Line) -> LineChart {
        let looks = [(reference.look, OF_REFERENCE), (line.look, of_other(line))];
        let marks = self.marks.iter().filter_map(|mark| {
            let (_, look) = looks.into_iter().find(|(own, _)| *own == mark.look)?;
            Some(Mark { look, ..mark.clone() })
        });
        let lines = vec![
            Line { look: OF_REFERENCE, companion: Vec::new(), ..reference.clone() },
            Line { look: of_other(line), ..line.clone() },
        ];
        LineChart { lines, marks: marks.collect(), ..self.clone() }
    }

    fn plot(&self, area: &Area, (x, y): Ranges, size: Size) -> Result<()> {
        let (titled, right) = (size.axis_titles, if self.levels.is_empty() { 12.0 } else { size.right });
        let mut chart = ChartBuilder::on(area)
            .margin(px(8.0))
            .margin_right(px(right))
            .x_label_area_size(px(if titled { 42.0 } else { 20.0 }))
            .y_label_area_size(px(self.label_width(&y, size).min(f64::from(MOST_FOR_NUMBERS))))
            .build_cartesian_2d(BoundedAxis::from(x), BoundedAxis::from(y))?;
        draw_mesh(
            chart
                .configure_mesh()
                .x_labels(size.ticks)
                .y_labels(size.ticks)
                .x_desc(if titled { &self.x.label } else { "" })
                .y_desc(if titled { &self.y.label } else { "" })
                .x_label_formatter(&|value| (self.x.format)(*value))
                .y_label_formatter(&|value| (self.y.format)(*value)),
            size.numbers,
        )?;
        let x_end = chart.plotting_area().get_x_range().end;
        let ends: Vec<(i32, i32)> = self.levels.iter().map(|level| chart.backend_coord(&(x_end, level.y))).collect();
        self.name_levels(area, &ends, size)?;
        let area = chart.plotting_area();
        for (number, level) in self.levels.iter().enumerate() {
            let points = vec![(area.get_x_range().start, level.y), (x_end, level.y)];
            stroke(area, points, (INK.to_rgba(), level_dash(number, level)), 1.2)?;
        }
        for line in &self.lines {
            let low = line.points.iter().filter_map(|point| Some((point.x, point.band?.0)));
            let high = line.points.iter().filter_map(|point| Some((point.x, point.band?.1)));
            let rim: Vec<(f64, f64)> = high.chain(low.rev()).collect();
            if !rim.is_empty() {
                area.draw(&Polygon::new(rim, line.look.colour.mix(0.22).filled()))?;
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
    }

    /// Writes the name of each level at its right end. `ends`: right ends in units of the whole picture.
    fn name_levels(&self, area: &Area, ends: &[(i32, i32)], size: Size) -> Result<()> {
        let corner = area.get_base_pixel();
        let mut order: Vec<usize> = (0..ends.len()).collect();
        order.sort_by_key(|&index| ends[index].1);
        let mut free_from = i32::MIN;
        for index in order {
            let (x, y) = ends[index];
            let y = (y - corner.1).max(free_from);
            free_from = y + px(1.25 * size.names);
            let at = (x - corner.0 + px(4), y);
            write_at(area, &self.levels[index].name, at, size.names, (HPos::Left, VPos::Center))?;
        }
        Ok(())
    }

    fn draw_line(&self, area: &Plot, index: usize, line: &Line) -> Result<()> {
        let colour = line.look.colour;
        stroke(area, line.companion.clone(), (colour.to_rgba(), Dash::Dotted), 1.0)?;
        for seed in &line.seeds {
            stroke(area, seed.clone(), (colour.mix(0.45), Dash::Solid), 0.8)?;
        }
        // The line is thin from the first point at which runs are missing. Both parts share the point between them.
        let whole = line.points.iter().take_while(|point| point.whole).count();
        let places = |points: &[LinePoint]| points.iter().map(|point| (point.x, point.y)).collect::<Vec<_>>();
        stroke(area, places(&line.points[..whole]), (colour.to_rgba(), line.look.dash), 2.0)?;
        stroke(area, places(&line.points[whole.saturating_sub(1)..]), (colour.to_rgba(), line.look.dash), 0.8)?;
        if let [only] = &line.points[..] {
            mark(area, (only.x, only.y), line.look, 11.0, true)?;
            let style = anchored(text(11.0, INK), HPos::Left, VPos::Center);
            let beside = Text::new((self.y.format)(only.y), (px(9), 0), style);
            area.draw(&(EmptyElement::at((only.x, only.y)) + beside))?;
            return Ok(());
        }
        // Each line has its markers at different points.
        let every = line.points.len().div_ceil(MARKERS).max(1);
        for point in line.points.iter().skip(index % every).step_by(every) {
            mark(area, (point.x, point.y), line.look, 7.0, true)?;
        }
        Ok(())
    }

    fn legend_against(&self, reference: &Line, of_other: Look) -> Vec<LegendEntry> {
        let mut entries = vec![
            LegendEntry::new(LegendSample::Curve(OF_REFERENCE), &format!("in all panels: {}", reference.label)),
            LegendEntry::new(LegendSample::Curve(of_other), "method in the panel's title"),
        ];
        // Marks have the look of their line, which is not the one in the panels. One entry stands for all of them.
        entries.extend(self.legend_of_the_rest().filter(|entry| !matches!(entry.sample, LegendSample::Hollow(_))));
        let marks: Vec<&str> = self.marks.iter().map(|mark| mark.label.as_str()).collect();
        if !marks.is_empty() {
            entries.push(LegendEntry::new(LegendSample::Hollow(of_other), &marks.join("; ")));
        }
        entries
    }

    fn legend_of_the_rest(&self) -> impl Iterator<Item = LegendEntry> {
        let dotted = LegendSample::Level(INK, Dash::Dotted);
        let companions = self.companions.iter().map(move |label| LegendEntry::new(dotted, label));
        let levels =
            self.levels.iter().enumerate().map(|(number, level)| {
                LegendEntry::new(LegendSample::Level(INK, level_dash(number, level)), &level.label)
            });
        let marks = self.marks.iter().map(|mark| LegendEntry::new(LegendSample::Hollow(mark.look), &mark.label));
        companions.chain(levels).chain(marks).chain(LegendEntry::of_note(&self.note))
    }

    /// Returns the ranges of the axes: everything that is drawn, and a margin.
    fn ranges(&self) -> Ranges {
        let mut places: Vec<(f64, f64)> = Vec::new();
        let mut heights: Vec<f64> = self.levels.iter().map(|level| level.y).collect();
        for line in &self.lines {
            places.extend(line.points.iter().map(|point| (point.x, point.y)));
            places.extend(line.seeds.iter().flatten());
            heights.extend(line.points.iter().filter_map(|point| point.band).flat_map(|(low, high)| [low, high]));
            heights.extend(line.companion.iter().map(|(_, y)| y));
        }
        for (x, y, error) in self.marks.iter().flat_map(|mark| &mark.points) {
            let error = error.unwrap_or(0.0);
            places.extend([(*x, y - error), (*x, y + error)]);
        }
        let right = places.iter().map(|(x, _)| *x).fold(self.x_end, f64::max).max(f64::MIN_POSITIVE);
        let (low, high) = ends_of(heights.into_iter().chain(places.iter().map(|(_, y)| *y)));
        (0.0..right * 1.015, with_air(if low.is_finite() { (low, high) } else { (0.0, 1.0) }))
    }

    fn label_width(&self, y: &Range<f64>, size: Size) -> f64 {
        // Some formats write whole numbers only.
        let ends = [y.start, y.end, y.start.ceil(), y.end.floor()];
        let widest = ends.map(|value| text_width(&(self.y.format)(value), size.numbers)).into_iter().max();
        f64::from(widest.unwrap_or(0)) / f64::from(SCALE) + if size.axis_titles { 30.0 } else { 8.0 }
    }
}

fn level_dash(number: usize, level: &Level) -> Dash {
    const MEASURED: [Dash; 3] = [Dash::Dashed, Dash::Short, Dash::Sparse];
    if level.measured { MEASURED[number % MEASURED.len()] } else { Dash::Long }
}
