//! Common parts of all pictures: a finely drawn SVG, pens and fonts in pixels, and colours.
//!
//! Colour-blind readers can distinguish the colours (the palette of Okabe and Ito, 2008). Shades go from light to dark
//! in one hue, so they keep their order in black and white. The pictures themselves are in [`crate::plot`] (episodes)
//! and [`crate`] (runs).
//!
//! - `axis`: an axis of numbers that ends its work for any numbers.

mod axis;

use anyhow::Result;
use plotters::chart::MeshStyle;
use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use dials_core::outside::Printable;

pub use axis::BoundedAxis;

/// A whole picture, or a part of it.
pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Units per pixel. The drawing crate has only whole units; with one unit per pixel, fine lines would look ragged.
pub(crate) const SCALE: u32 = 4;

pub(crate) const INK: RGBColor = RGBColor(0x1a, 0x1a, 0x1a);
pub(crate) const PAPER: RGBColor = RGBColor(0xfe, 0xfe, 0xfe);

// Okabe and Ito's palette without its yellow, which is invisible on white, and its black, which is the ink.
pub(crate) const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xb2);
pub(crate) const ORANGE: RGBColor = RGBColor(0xe6, 0x9f, 0x00);
pub(crate) const GREEN: RGBColor = RGBColor(0x00, 0x9e, 0x73);
pub(crate) const PURPLE: RGBColor = RGBColor(0xcc, 0x79, 0xa7);
pub(crate) const VERMILLION: RGBColor = RGBColor(0xd5, 0x5e, 0x00);
pub(crate) const SKY: RGBColor = RGBColor(0x56, 0xb4, 0xe9);

pub(crate) fn px(pixels: impl Into<f64>) -> i32 {
    (pixels.into() * f64::from(SCALE)).round() as i32
}

pub(crate) fn pen(colour: impl Color, pixels: impl Into<f64>) -> ShapeStyle {
    ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: px(pixels) as u32 }
}

pub(crate) fn text(pixels: impl Into<f64>, colour: impl Color) -> TextStyle<'static> {
    // The SVG backend divides font sizes by 1.24.
    ("sans-serif", f64::from(px(pixels)) * 1.24).into_font().color(&colour)
}

/// Makes the style of a text with this point of it at its place; without this it is the upper left corner.
pub(crate) fn anchored(style: TextStyle<'static>, horizontal: HPos, vertical: VPos) -> TextStyle<'static> {
    style.pos(Pos::new(horizontal, vertical))
}

/// Writes a text in ink, with its upper left corner at a place in units. `size`: its height in pixels.
pub(crate) fn write(area: &Area, words: &str, at: (i32, i32), size: impl Into<f64>) -> Result<()> {
    write_at(area, words, at, size, (HPos::Left, VPos::Top))
}

/// Like [`write()`], with another point of the text at the place.
pub(crate) fn write_at(
    area: &Area,
    words: &str,
    at: (i32, i32),
    size: impl Into<f64>,
    (horizontal, vertical): (HPos, VPos),
) -> Result<()> {
    Ok(area.draw_text(words, &anchored(text(size, INK), horizontal, vertical), at)?)
}

/// Estimates the width of a text in units, because the drawing crate cannot measure text without a font library.
pub(crate) fn text_width(words: &str, pixels: f64) -> i32 {
    px(words.chars().count() as f64 * pixels * 0.56)
}

/// Returns a name of at most `letters` letters, and three points if it was longer. The beginning and the end are kept, because ids of joined
/// junctions often begin alike.
pub(crate) fn shortened(name: &str, letters: usize) -> String {
    let all: Vec<char> = name.chars().collect();
    if all.len() <= letters {
        return name.to_owned();
    }
    let (begin, end) = (letters.div_ceil(2), letters / 2);
    let part = |letters: &[char]| letters.iter().collect::<String>();
    format!("{}...{}", part(&all[..begin]), part(&all[all.len() - end..]))
}

/// Draws axes and grid in the style of all charts. `numbers`: font size of the numbers, in pixels.
pub(crate) fn draw_mesh<X, Y>(mesh: &mut MeshStyle<'_, '_, X, Y, SVGBackend<'_>>, numbers: f64) -> Result<()>
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

/// Returns the shade for a share from 0 (light) to 1 (dark).
pub(crate) fn shade(share: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 3] = [[247.0, 251.0, 255.0], [107.0, 174.0, 214.0], [8.0, 48.0, 107.0]];
    let place = share.clamp(0.0, 1.0) * 2.0;
    let (from, to, part) = if place < 1.0 { (STOPS[0], STOPS[1], place) } else { (STOPS[1], STOPS[2], place - 1.0) };
    let [red, green, blue] = std::array::from_fn(|i| (from[i] + (to[i] - from[i]) * part).round() as u8);
    RGBColor(red, green, blue)
}

/// Returns the shade of a value in a range: the higher, the darker.
pub(crate) fn shade_of(value: f64, (low, high): (f64, f64)) -> RGBColor {
    shade(if high > low { (value - low) / (high - low) } else { 0.5 })
}

/// Returns the ends of these values; of none, an empty range from infinity.
pub(crate) fn ends_of(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// Least span of shades, as a share of the largest value.
const LEAST_SPAN: f64 = 0.25;

/// Widens a range of values for [`shade`]: values that hardly differ must not look as if they did.
pub(crate) fn widened((low, high): (f64, f64)) -> (f64, f64) {
    let more = (LEAST_SPAN * low.abs().max(high.abs()) - (high - low)).max(0.0);
    (low - more / 2.0, high + more / 2.0)
}

pub(crate) fn ink_over(colour: RGBColor) -> RGBColor {
    if luminance(colour) > 0.5 { BLACK } else { WHITE }
}

/// Returns the brightness of a colour from 0 to 1, weighted as the eye does (ITU-R BT.709, without gamma).
pub(crate) fn luminance(RGBColor(red, green, blue): RGBColor) -> f64 {
    (0.2126 * f64::from(red) + 0.7152 * f64::from(green) + 0.0722 * f64::from(blue)) / 255.0
}

#[derive(Clone)]
pub struct Svg(String);

impl Svg {
    /// Draws a picture of `width` x `height` pixels.
    pub(crate) fn draw(width: u32, height: u32, paint: impl FnOnce(&Area) -> Result<()>) -> Result<Svg> {
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, (width * SCALE, height * SCALE)).into_drawing_area();
            area.fill(&PAPER)?;
            paint(&area)?;
            area.present()?;
        }
        let drawn = format!("width=\"{}\" height=\"{}\"", width * SCALE, height * SCALE);
        let text = text.replacen(&drawn, &format!("width=\"{width}\" height=\"{height}\""), 1);
        Ok(Svg(with_printable_names(&text)))
    }

    /// Takes a picture that is written already: names in it are escaped, and its ink and its paper are those of all pictures.
    pub(crate) fn of_text(text: String) -> Svg {
        Svg(text)
    }

    /// Returns the picture as an SVG file, on white.
    pub fn file(&self) -> String {
        self.0.replace(&hex(PAPER), "#FFFFFF")
    }

    /// Returns the picture for a page, in the colour of its text. Screen readers read `title`, without markup.
    pub(crate) fn inline(&self, title: &str) -> String {
        let named = format!("<svg role=\"img\" aria-label=\"{title}\" ");
        self.0.replacen("<svg ", &named, 1).replace(&hex(PAPER), "none").replace(&hex(INK), "currentColor")
    }
}

/// The drawing crate escapes markup, but XML forbids most control characters, and the others act on a terminal.
fn with_printable_names(svg: &str) -> String {
    let mut clean = String::with_capacity(svg.len());
    let mut rest = svg;
    while let Some((before, content, after)) = next_text(rest) {
        clean += before;
        clean += &Printable(content).to_string();
        rest = after;
    }
    clean + rest
}

/// Splits at the next text: before its content, the content, and after it. In all of them markup is escaped.
fn next_text(svg: &str) -> Option<(&str, &str, &str)> {
    let begin = svg.find("<text ")?;
    let content = begin + svg[begin..].find(">\n")? + ">\n".len();
    let end = content + svg[content..].find("\n</text>")?;
    Some((&svg[..content], &svg[content..end], &svg[end..]))
}

pub(crate) fn hex(RGBColor(red, green, blue): RGBColor) -> String {
    format!("#{red:02X}{green:02X}{blue:02X}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_is_too_long_keeps_its_beginning_and_its_end() {
        assert_eq!(shortened("cluster_1", 9), "cluster_1");
        assert_eq!(shortened("cluster_11_22_33", 9), "clust...2_33");
    }

    #[test]
    fn shades_get_darker_all_the_way() {
        let shades: Vec<f64> = (0..=20).map(|share| luminance(shade(f64::from(share) / 20.0))).collect();
        assert!(shades.windows(2).all(|pair| pair[1] < pair[0]), "{shades:?}");
        assert_eq!((shade(0.0), shade(1.0)), (RGBColor(247, 251, 255), RGBColor(8, 48, 107)));
        assert_eq!((shade(-1.0), shade(2.0)), (shade(0.0), shade(1.0)));
        assert_eq!((ink_over(shade(0.0)), ink_over(shade(1.0))), (BLACK, WHITE));
    }
}
