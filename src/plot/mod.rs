//! Pictures as SVG: one function per picture, text out.
//!
//! This file holds what all of them share: paper, type, and colours that colour-blind readers tell apart and that differ
//! in brightness, so that a picture printed in black and white can be read as well.

mod queues;
mod returns_map;
mod signal_timing;
mod space_time;

use anyhow::Result;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

pub use queues::queues;
pub use returns_map::returns_map;
pub use signal_timing::signal_timing;
pub use space_time::space_time;

/// What was played: under the title of every picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct About {
    /// Run or config, policies or controller.
    pub subject: String,
    pub seed: u64,
}

impl About {
    fn of_episode(&self) -> String {
        format!("{}, first episode of seed {}", self.subject, self.seed)
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

const FONT: &str = "sans-serif";
const INK: RGBColor = RGBColor(38, 38, 38);
/// What should not catch the eye: grids, the second line of a title.
const FAINT: RGBColor = RGBColor(110, 110, 110);
const PALE: RGBColor = RGBColor(232, 232, 232);
/// Blue, orange and sky blue of Okabe and Ito's palette for all kinds of colour vision.
const BLUE: RGBColor = RGBColor(0, 114, 178);
const ORANGE: RGBColor = RGBColor(230, 159, 0);
const SKY: RGBColor = RGBColor(86, 180, 233);

/// Pixels that every picture keeps free around it.
const MARGIN: i32 = 18;
/// Pixels of the title and the line under it.
const HEAD: i32 = 64;

/// Parts of a pixel that pictures are drawn in: plotters rounds to whole units, and a car's line of many short pieces
/// would have corners.
const FINE: i32 = 4;

fn px(pixels: i32) -> i32 {
    FINE * pixels
}

/// A picture of this width and height in pixels, with a head; `draw` is given what is below, in units of [`px`].
fn picture(
    (width, height): (i32, i32),
    title: &str,
    about: &str,
    draw: impl FnOnce(&Area<'_>) -> Result<()>,
) -> Result<String> {
    let size = |width: i32, height: i32| format!("width=\"{width}\" height=\"{height}\"");
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(width) as u32, px(height) as u32)).into_drawing_area();
        root.fill(&WHITE)?;
        let bold = (FONT, px(19), FontStyle::Bold).into_text_style(&root).color(&INK);
        root.draw_text(title, &bold, (px(MARGIN), px(14)))?;
        root.draw_text(about, &type_of(13, FAINT), (px(MARGIN), px(40)))?;
        draw(&root.margin(px(HEAD), px(MARGIN), px(MARGIN), px(MARGIN)))?;
        root.present()?;
    }
    Ok(svg.replacen(&size(px(width), px(height)), &size(width, height), 1))
}

/// The axes of a chart: `values` beside it, seconds below it unless the chart below it tells them.
fn draw_axes(chart: &mut Chart<'_, '_>, values: &str, value_labels: usize, seconds: bool) -> Result<()> {
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(line(PALE, 1))
        .x_labels(if seconds { 11 } else { 0 })
        .x_desc(if seconds { "time (s)" } else { "" })
        .x_label_formatter(&|second| format!("{second:.0}"))
        .y_labels(value_labels)
        .y_desc(values)
        .y_label_formatter(&|value| format!("{value:.0}"))
        .axis_desc_style(type_of(14, INK))
        .label_style(type_of(13, INK))
        .axis_style(line(FAINT, 1))
        .set_all_tick_mark_size(px(5))
        .draw()?;
    Ok(())
}

/// A line of this width in pixels.
fn line(colour: RGBColor, width: i32) -> ShapeStyle {
    colour.stroke_width(px(width) as u32)
}

/// Letters of this size in pixels and of this colour.
fn type_of(size: i32, colour: RGBColor) -> TextStyle<'static> {
    (FONT, px(size)).into_font().color(&colour)
}

fn anchored(style: TextStyle<'static>, horizontal: HPos, vertical: VPos) -> TextStyle<'static> {
    style.pos(Pos::new(horizontal, vertical))
}
