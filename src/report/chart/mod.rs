//! Charts as SVG: lines, rows, bars and heat maps, in colours that colour-blind readers tell apart (Okabe and Ito 2008), with a
//! dash and a marker for each so that they are told apart in black and white too.
//!
//! Pictures are drawn four times as large as they are shown, because the drawing crate knows whole pixels only.

mod bars;
mod heat;
mod legend;
mod lines;
mod look;
mod rows;

use anyhow::{Result, anyhow};
use plotters::coord::Shift;
use plotters::prelude::*;

pub use bars::{Bar, BarChart, Cluster, Scale};
pub use heat::{Cell, HeatMap, Panel};
pub use lines::{Axis, Level, Line, LineChart, LinePoint, MOST_BANDS, Mark};
pub use look::{Look, Looks};
pub use rows::{Row, RowChart};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Units per pixel.
const SCALE: u32 = 4;
/// Of text and axes. Inside a page it becomes the colour of the page's text.
const INK: RGBColor = RGBColor(0x1a, 0x1a, 0x1a);
/// Behind everything. Inside a page it becomes transparent.
const PAPER: RGBColor = RGBColor(0xfe, 0xfe, 0xfe);
const FONT: &str = "sans-serif";

/// Pixels as units.
fn px(pixels: f64) -> i32 {
    (pixels * f64::from(SCALE)).round() as i32
}

/// A text style of so many pixels.
fn text(pixels: f64, colour: impl Color) -> TextStyle<'static> {
    // The SVG backend divides sizes by this.
    (FONT, f64::from(px(pixels)) * 1.24).into_font().color(&colour)
}

/// About how wide a text is drawn, in units: the crate measures no fonts without a font library.
fn text_width(words: &str, pixels: f64) -> i32 {
    px(words.chars().count() as f64 * pixels * 0.56)
}

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Svg(String);

impl Svg {
    /// Draws a picture of so many pixels.
    fn draw(width: u32, height: u32, paint: impl FnOnce(&Area) -> Result<()>) -> Result<Svg> {
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, (width * SCALE, height * SCALE)).into_drawing_area();
            area.fill(&PAPER).map_err(failed)?;
            paint(&area)?;
            area.present().map_err(failed)?;
        }
        let drawn = format!("width=\"{}\" height=\"{}\"", width * SCALE, height * SCALE);
        Ok(Svg(text.replacen(&drawn, &format!("width=\"{width}\" height=\"{height}\""), 1)))
    }

    /// As a file of its own, on white.
    pub fn file(&self) -> String {
        self.0.replace(&hex(PAPER), "#FFFFFF")
    }

    /// As a part of a page, in the page's colours. `title` is what is read aloud.
    pub fn inline(&self, title: &str) -> String {
        let named = format!("<svg role=\"img\" aria-label=\"{}\" ", super::document::escape(title));
        self.0.replacen("<svg ", &named, 1).replace(&hex(PAPER), "none").replace(&hex(INK), "currentColor")
    }
}

fn hex(RGBColor(red, green, blue): RGBColor) -> String {
    format!("#{red:02X}{green:02X}{blue:02X}")
}

/// From 0 to 1, as the eye weighs colours (ITU-R BT.709, without gamma).
fn luminance(RGBColor(red, green, blue): RGBColor) -> f64 {
    (0.2126 * f64::from(red) + 0.7152 * f64::from(green) + 0.0722 * f64::from(blue)) / 255.0
}

fn failed(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("a chart cannot be drawn: {error}")
}
