//! What all pictures have in common: an SVG that is drawn finely, pens and type in pixels, and colours.
//!
//! Colours are told apart by colour-blind readers (the palette of Okabe and Ito, 2008), and shades go from light to dark in
//! one hue, so that they are the same in black and white. Which picture shows what is in [`crate::plot`] (episodes) and
//! [`crate::report`] (runs).

use anyhow::Result;
use plotters::chart::MeshStyle;
use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;

/// All of a picture, or a part of it.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Units per pixel: the drawing crate knows whole units only, and fine lines would have corners.
pub const SCALE: u32 = 4;

/// Of text and axes.
pub const INK: RGBColor = RGBColor(0x1a, 0x1a, 0x1a);
/// Behind everything.
const PAPER: RGBColor = RGBColor(0xfe, 0xfe, 0xfe);

// Okabe and Ito's palette without its yellow, which white paper swallows, and its black, which is the ink.
pub const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xb2);
pub const ORANGE: RGBColor = RGBColor(0xe6, 0x9f, 0x00);
pub const GREEN: RGBColor = RGBColor(0x00, 0x9e, 0x73);
pub const PURPLE: RGBColor = RGBColor(0xcc, 0x79, 0xa7);
pub const VERMILLION: RGBColor = RGBColor(0xd5, 0x5e, 0x00);
pub const SKY: RGBColor = RGBColor(0x56, 0xb4, 0xe9);

/// Pixels as units.
pub fn px(pixels: impl Into<f64>) -> i32 {
    (pixels.into() * f64::from(SCALE)).round() as i32
}

/// A line of so many pixels.
pub fn pen(colour: impl Color, pixels: impl Into<f64>) -> ShapeStyle {
    ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: px(pixels) as u32 }
}

/// A text style of so many pixels.
pub fn text(pixels: impl Into<f64>, colour: impl Color) -> TextStyle<'static> {
    // The SVG backend divides sizes by this.
    ("sans-serif", f64::from(px(pixels)) * 1.24).into_font().color(&colour)
}

/// About how wide a text is drawn, in units: the crate measures no fonts without a font library.
pub fn text_width(words: &str, pixels: f64) -> i32 {
    px(words.chars().count() as f64 * pixels * 0.56)
}

/// Draws axes and grid as every chart has them, with numbers of so many pixels.
pub fn draw_mesh<X, Y>(mesh: &mut MeshStyle<'_, '_, X, Y, SVGBackend<'_>>, numbers: f64) -> Result<()>
where
    X: Ranged + ValueFormatter<X::ValueType>,
    Y: Ranged + ValueFormatter<Y::ValueType>,
{
    mesh.label_style(text(numbers, INK))
        .axis_desc_style(text(13, INK))
        .axis_style(pen(INK, 1))
        .bold_line_style(pen(INK.mix(0.13), 1))
        .light_line_style(TRANSPARENT)
        .set_all_tick_mark_size(px(4))
        .draw()?;
    Ok(())
}

/// The shade of a share from 0 (light) to 1 (dark).
pub fn shade(share: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 3] = [[247.0, 251.0, 255.0], [107.0, 174.0, 214.0], [8.0, 48.0, 107.0]];
    let place = share.clamp(0.0, 1.0) * 2.0;
    let (from, to, part) = if place < 1.0 { (STOPS[0], STOPS[1], place) } else { (STOPS[1], STOPS[2], place - 1.0) };
    let [red, green, blue] = std::array::from_fn(|i| (from[i] + (to[i] - from[i]) * part).round() as u8);
    RGBColor(red, green, blue)
}

/// Black or white, whichever is read over this colour.
pub fn ink_over(colour: RGBColor) -> RGBColor {
    if luminance(colour) > 0.5 { BLACK } else { WHITE }
}

/// From 0 to 1, as the eye weighs colours (ITU-R BT.709, without gamma).
pub fn luminance(RGBColor(red, green, blue): RGBColor) -> f64 {
    (0.2126 * f64::from(red) + 0.7152 * f64::from(green) + 0.0722 * f64::from(blue)) / 255.0
}

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Svg(String);

impl Svg {
    /// Draws a picture of so many pixels.
    ///
    /// # Errors
    ///
    /// Those of `paint`.
    pub fn draw(width: u32, height: u32, paint: impl FnOnce(&Area) -> Result<()>) -> Result<Svg> {
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, (width * SCALE, height * SCALE)).into_drawing_area();
            area.fill(&PAPER)?;
            paint(&area)?;
            area.present()?;
        }
        let drawn = format!("width=\"{}\" height=\"{}\"", width * SCALE, height * SCALE);
        Ok(Svg(text.replacen(&drawn, &format!("width=\"{width}\" height=\"{height}\""), 1)))
    }

    /// As a file of its own, on white.
    pub fn file(&self) -> String {
        self.0.replace(&hex(PAPER), "#FFFFFF")
    }

    /// As a part of a page of HTML, without paper and in the colour of the page's text. `title`, which must not hold any
    /// markup, is what is read aloud.
    pub fn inline(&self, title: &str) -> String {
        let named = format!("<svg role=\"img\" aria-label=\"{title}\" ");
        self.0.replacen("<svg ", &named, 1).replace(&hex(PAPER), "none").replace(&hex(INK), "currentColor")
    }
}

fn hex(RGBColor(red, green, blue): RGBColor) -> String {
    format!("#{red:02X}{green:02X}{blue:02X}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shades_get_darker_all_the_way() {
        let shades: Vec<f64> = (0..=20).map(|share| luminance(shade(f64::from(share) / 20.0))).collect();
        assert!(shades.windows(2).all(|pair| pair[1] < pair[0]), "{shades:?}");
        assert_eq!((shade(0.0), shade(1.0)), (RGBColor(247, 251, 255), RGBColor(8, 48, 107)));
        assert_eq!((shade(-1.0), shade(2.0)), (shade(0.0), shade(1.0)));
        assert_eq!((ink_over(shade(0.0)), ink_over(shade(1.0))), (BLACK, WHITE));
    }
}
