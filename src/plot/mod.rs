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
const MARGIN: u32 = 18;
/// Pixels of the title and the line under it.
const HEAD: u32 = 64;

/// A picture of this width and height in pixels, with a head; `draw` is given what is below.
fn picture(size: (u32, u32), title: &str, about: &str, draw: impl FnOnce(&Area<'_>) -> Result<()>) -> Result<String> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        let left = MARGIN as i32;
        root.draw_text(title, &(FONT, 19, FontStyle::Bold).into_text_style(&root).color(&INK), (left, 14))?;
        root.draw_text(about, &type_of(13, FAINT), (left, 40))?;
        draw(&root.margin(HEAD, MARGIN, MARGIN, MARGIN))?;
        root.present()?;
    }
    Ok(svg)
}

/// Letters of this size and colour.
fn type_of(size: u32, colour: RGBColor) -> TextStyle<'static> {
    (FONT, size).into_font().color(&colour)
}

fn anchored(style: TextStyle<'static>, horizontal: HPos, vertical: VPos) -> TextStyle<'static> {
    style.pos(Pos::new(horizontal, vertical))
}
