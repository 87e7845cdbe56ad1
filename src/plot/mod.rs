//! Pictures of an episode on roads as SVG: one function per picture.
//!
//! They are drawn from a [`crate::domain::road_trace`]: which simulator it comes from is unknown here.

mod queues;
mod returns_map;
mod signal_timing;
mod space_time;

use anyhow::Result;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::drawing::{Area, BLUE, GREEN, INK, ORANGE, PURPLE, SKY, Svg, draw_mesh, ink_over, pen, px, shade, text};

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

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// What should not catch the eye: grids, the second line of a title.
const FAINT: RGBColor = RGBColor(110, 110, 110);
const PALE: RGBColor = RGBColor(232, 232, 232);

/// Pixels that every picture keeps free around it.
const MARGIN: i32 = 18;
/// Pixels of the title and the line under it.
const HEAD: i32 = 64;

/// A picture of this width and height in pixels, with a head; `draw` is given what is below.
fn picture(
    (width, height): (i32, i32),
    title: &str,
    about: &str,
    draw: impl FnOnce(&Area<'_>) -> Result<()>,
) -> Result<Svg> {
    Svg::draw(width as u32, height as u32, |root| {
        root.draw_text(title, &text(15, INK), (px(MARGIN), px(14)))?;
        root.draw_text(about, &text(11, FAINT), (px(MARGIN), px(40)))?;
        draw(&root.margin(px(HEAD), px(MARGIN), px(MARGIN), px(MARGIN)))
    })
}

/// The axes of a chart: `values` beside it, seconds below it unless the chart below it tells them.
fn draw_axes(chart: &mut Chart<'_, '_>, values: &str, value_labels: usize, seconds: bool) -> Result<()> {
    draw_mesh(
        chart
            .configure_mesh()
            .disable_x_mesh()
            .x_labels(if seconds { 11 } else { 0 })
            .x_desc(if seconds { "time (s)" } else { "" })
            .x_label_formatter(&|second| format!("{second:.0}"))
            .y_labels(value_labels)
            .y_desc(values)
            .y_label_formatter(&|value| format!("{value:.0}")),
        11.0,
    )
}

fn anchored(style: TextStyle<'static>, horizontal: HPos, vertical: VPos) -> TextStyle<'static> {
    style.pos(Pos::new(horizontal, vertical))
}
