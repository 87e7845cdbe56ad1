//! The map of a city: its streets, and its lights in the colour of what is saved there.

use std::collections::HashMap;
use std::fmt::Write;

use super::read::{City, CityPlayer, Figure, PartFigures};
use crate::document::escape;
use crate::drawing::{BLUE, INK, PAPER, Svg, VERMILLION, ends_of, hex, shade};
use plotters::style::RGBColor;

/// Width in pixels; the page makes it narrower on a narrow screen.
const WIDTH: f64 = 720.0;
/// Least and largest height of the map in pixels.
const HEIGHT: (f64, f64) = (240.0, 900.0);
const MARGIN: f64 = 24.0;
/// Height of the legend in pixels.
const LEGEND: f64 = 84.0;
/// Largest number of lights that have their number beside them.
const MOST_NUMBERS: usize = 60;
/// Colour without a difference.
const NOTHING: RGBColor = RGBColor(0xb4, 0xb4, 0xb4);
/// Colour of streets that lead to no light.
const STREET: RGBColor = RGBColor(0xdc, 0xdc, 0xdc);

/// What colours show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scale {
    /// Seconds per car that are saved or lost; this many and more have the darkest colours.
    Difference(f64),
    /// Seconds per car, up to this many.
    Delay(f64),
}

impl Scale {
    pub(super) fn of(player: &CityPlayer, compares: bool) -> Scale {
        let value = |figures: &PartFigures| match compares {
            true => figures.delay_difference().map(|found| found.mean.abs()),
            false => figures.delay_s,
        };
        let mut values: Vec<f64> = player.lights.iter().filter_map(|light| value(&light.figures)).collect();
        values.sort_by(f64::total_cmp);
        // One light in ten may be beyond the ends, so that one jam does not make all others alike.
        let most = values.get(values.len() * 9 / 10).copied().unwrap_or(0.0);
        let rounded = [5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0].into_iter().find(|&end| most <= end).unwrap_or(600.0);
        if compares { Scale::Difference(rounded) } else { Scale::Delay(rounded) }
    }

    fn colour(self, value: f64) -> RGBColor {
        match self {
            Scale::Delay(most) => shade(0.15 + 0.85 * value / most),
            Scale::Difference(most) => {
                let share = (value / most).clamp(-1.0, 1.0);
                mixed(NOTHING, if share < 0.0 { BLUE } else { VERMILLION }, share.abs())
            }
        }
    }

    /// Returns the colour of a street that leads to a light: [`NOTHING`] if its difference is unclear. No cars: `None`.
    fn of_street(self, figures: &PartFigures) -> Option<RGBColor> {
        let value = self.value(figures)?;
        let unclear = matches!(self, Scale::Difference(_)) && is_unclear(figures.delay_difference());
        Some(if unclear { NOTHING } else { self.colour(value) })
    }

    fn value(self, figures: &PartFigures) -> Option<f64> {
        match self {
            Scale::Delay(_) => figures.delay_s,
            Scale::Difference(_) => figures.delay_difference().map(|found| found.mean),
        }
    }
}

/// Returns whether the interval of a difference has 0 in it, or there is none.
pub(super) fn is_unclear(difference: Option<Figure>) -> bool {
    difference.is_none_or(|found| found.half_width_95.is_none_or(|half_width| found.mean.abs() <= half_width))
}

fn mixed(from: RGBColor, to: RGBColor, share: f64) -> RGBColor {
    let part = |from: u8, to: u8| (f64::from(from) + (f64::from(to) - f64::from(from)) * share).round() as u8;
    RGBColor(part(from.0, to.0), part(from.1, to.1), part(from.2, to.2))
}

/// Draws the map. `player`: whose figures are shown; `order`: ids of the lights in the order of their numbers.
pub(super) fn map(city: &City, player: &CityPlayer, order: &[&str], compares: bool) -> Svg {
    let scale = Scale::of(player, compares);
    let frame = Frame::around(city, player);
    let mut svg = format!(
        "<svg width=\"{WIDTH}\" height=\"{:.0}\" viewBox=\"0 0 {WIDTH} {:.0}\" class=\"map\" \
         font-family=\"sans-serif\" xmlns=\"http://www.w3.org/2000/svg\">\n<rect width=\"100%\" height=\"100%\" fill=\"{}\"/>\n",
        frame.height + LEGEND,
        frame.height + LEGEND,
        hex(PAPER),
    );
    roads_and_lights(&mut svg, city, player, order, scale, &frame);
    legend(&mut svg, scale, [MARGIN, frame.height], 1.0);
    svg += "</svg>\n";
    Svg::of_text(svg)
}

/// Draws the streets and the lights within a frame. Lights in `order` have their number beside them.
pub(super) fn roads_and_lights(
    svg: &mut String,
    city: &City,
    player: &CityPlayer,
    order: &[&str],
    scale: Scale,
    frame: &Frame,
) {
    let compares = matches!(scale, Scale::Difference(_));
    let approaches = player.lights.iter().flat_map(|light| &light.approaches);
    let coloured: HashMap<&str, RGBColor> =
        approaches.filter_map(|approach| Some((&*approach.edge, scale.of_street(&approach.figures)?))).collect();
    // Coloured streets lie over the others.
    for with_colour in [false, true] {
        for street in city.streets.iter().filter(|street| coloured.contains_key(&*street.edge) == with_colour) {
            let colour = coloured.get(&*street.edge).copied().unwrap_or(STREET);
            let width = (street.lanes as f64 * 0.7 + 0.6).min(4.0) * if with_colour { 1.4 } else { 1.0 } * frame.pen;
            let points: Vec<String> = street.shape_m.iter().map(|&place| frame.point(place)).collect();
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width:.1}\" stroke-linecap=\"round\"/>",
                points.join(" "),
                hex(colour)
            );
        }
    }
    for light in &player.lights {
        let [x, y] = frame.place(light.place_m);
        let unclear = compares && is_unclear(light.figures.delay_difference());
        let colour = scale.value(&light.figures).map_or(NOTHING, |value| scale.colour(value));
        let (fill, stroke) = if unclear { ("#ffffff".to_owned(), hex(colour)) } else { (hex(colour), hex(INK)) };
        let number = order.iter().position(|id| *id == light.id);
        let words = match scale.value(&light.figures) {
            Some(value) if compares => format!("{} ({}): {value:+.1} s per car", light.name, light.id),
            Some(value) => format!("{} ({}): {value:.1} s per car", light.name, light.id),
            None => format!("{} ({}): no cars", light.name, light.id),
        };
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{}\" fill=\"{fill}\" stroke=\"{stroke}\" stroke-width=\"{}\"><title>{}</title></circle>",
            6.0 * frame.pen,
            if unclear { 3.0 * frame.pen } else { 1.0 },
            escape(&words)
        );
        if let Some(number) = number.filter(|&number| number < MOST_NUMBERS) {
            // Once in white behind it, so that it can be read over a street.
            let ink = format!("fill=\"{}\"", hex(INK));
            for look in ["fill=\"#ffffff\" stroke=\"#ffffff\" stroke-width=\"3\"", &ink] {
                let (x, y, number, size) = (x + 8.0 * frame.pen, y - 6.0 * frame.pen, number + 1, 14.0 * frame.pen);
                let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" {look}>{number}</text>");
            }
        }
    }
}

/// Draws what the colours stand for. `size`: 1 for letters of 14 pixels.
pub(super) fn legend(svg: &mut String, scale: Scale, [left, top]: [f64; 2], size: f64) {
    let (values, words): (Vec<f64>, &str) = match scale {
        Scale::Difference(most) => (
            vec![-most, -most / 2.0, 0.0, most / 2.0, most],
            "difference of the delay in seconds per car: blue is saved, orange is lost",
        ),
        Scale::Delay(most) => (vec![0.0, most / 4.0, most / 2.0, most * 0.75, most], "delay in seconds per car"),
    };
    let mut text = |x: f64, y: f64, words: &str, anchor: &str| {
        let words = escape(words);
        let _ = writeln!(
            svg,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{}\" fill=\"{}\" text-anchor=\"{anchor}\">{words}</text>",
            14.0 * size,
            hex(INK)
        );
    };
    text(left, top + 18.0 * size, words, "start");
    let width = 76.0 * size;
    for (place, &value) in values.iter().enumerate() {
        let x = left + place as f64 * width;
        let words = if matches!(scale, Scale::Difference(_)) && value != 0.0 {
            format!("{value:+}")
        } else {
            value.to_string()
        };
        text(x + width / 2.0, top + 54.0 * size, &words, "middle");
    }
    if let Scale::Difference(_) = scale {
        let words = "a light as a ring, a street in grey: no clear difference";
        text(left, top + 74.0 * size, words, "start");
    }
    for (place, &value) in values.iter().enumerate() {
        let x = left + place as f64 * width;
        let colour = hex(scale.colour(value));
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"{width}\" height=\"{}\" fill=\"{colour}\"/>",
            top + 25.0 * size,
            14.0 * size
        );
    }
}

/// The part of the net that is drawn.
pub(super) struct Frame {
    west_m: f64,
    north_m: f64,
    px_per_m: f64,
    left: f64,
    height: f64,
    /// Sizes of lines and lights, in those of a page.
    pen: f64,
}

impl Frame {
    fn around(city: &City, player: &CityPlayer) -> Frame {
        let Some([west_m, east_m, south_m, north_m]) = ends(city, player) else {
            return Frame { west_m: 0.0, north_m: 0.0, px_per_m: 1.0, left: MARGIN, height: HEIGHT.0, pen: 1.0 };
        };
        let (wide_m, tall_m) = ((east_m - west_m).max(1.0), (north_m - south_m).max(1.0));
        let px_per_m = ((WIDTH - 2.0 * MARGIN) / wide_m).min((HEIGHT.1 - 2.0 * MARGIN) / tall_m);
        let height = (tall_m * px_per_m + 2.0 * MARGIN).clamp(HEIGHT.0, HEIGHT.1);
        let left = (WIDTH - wide_m * px_per_m) / 2.0;
        let above = (height - tall_m * px_per_m) / 2.0;
        Frame { west_m, north_m: north_m + above / px_per_m, px_per_m, left, height, pen: 1.0 }
    }

    /// Fits all into a box, in its middle. There is nothing to draw: `None`.
    pub(super) fn within(
        city: &City,
        player: &CityPlayer,
        [left, top, width, height]: [f64; 4],
        pen: f64,
    ) -> Option<Frame> {
        let [west_m, east_m, south_m, north_m] = ends(city, player)?;
        let (wide_m, tall_m) = ((east_m - west_m).max(1.0), (north_m - south_m).max(1.0));
        let px_per_m = (width / wide_m).min(height / tall_m);
        let left = left + (width - wide_m * px_per_m) / 2.0;
        let above = top + (height - tall_m * px_per_m) / 2.0;
        Some(Frame { west_m, north_m: north_m + above / px_per_m, px_per_m, left, height, pen })
    }

    fn place(&self, [x_m, y_m]: [f64; 2]) -> [f64; 2] {
        [self.left + (x_m - self.west_m) * self.px_per_m, (self.north_m - y_m) * self.px_per_m]
    }

    fn point(&self, place_m: [f64; 2]) -> String {
        let [x, y] = self.place(place_m);
        format!("{x:.1},{y:.1}")
    }
}

/// Returns the west, east, south and north end of all streets and lights, in metres.
fn ends(city: &City, player: &CityPlayer) -> Option<[f64; 4]> {
    let streets = city.streets.iter().flat_map(|street| &street.shape_m);
    let places: Vec<[f64; 2]> = streets.copied().chain(player.lights.iter().map(|light| light.place_m)).collect();
    let ends = |axis: usize| ends_of(places.iter().map(|place| place[axis]).filter(|value| value.is_finite()));
    let ((west_m, east_m), (south_m, north_m)) = (ends(0), ends(1));
    (east_m >= west_m && north_m >= south_m).then_some([west_m, east_m, south_m, north_m])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_time_is_blue_lost_time_is_orange_and_none_is_grey() {
        let scale = Scale::Difference(20.0);
        assert_eq!([-20.0, -90.0].map(|value| scale.colour(value)), [BLUE; 2]);
        assert_eq!([20.0, 90.0].map(|value| scale.colour(value)), [VERMILLION; 2]);
        assert_eq!(scale.colour(0.0), NOTHING);
    }

    #[test]
    fn a_difference_is_unclear_if_it_may_be_none() {
        let figure = |mean, half_width_95| Some(Figure { mean, half_width_95 });
        assert!(is_unclear(figure(-5.0, Some(6.0))) && is_unclear(figure(-5.0, None)) && is_unclear(None));
        assert!(!is_unclear(figure(-5.0, Some(4.0))));
    }
}
