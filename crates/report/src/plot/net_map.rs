//! The map of a road network that pictures are drawn on: lanes in grey, lights as numbered discs, and their names.

use anyhow::Result;

use super::*;
use crate::drawing::SCALE;
use dials_core::domain::road_trace::Line;

/// Longer side of the map in pixels.
const LONGER: f64 = 1000.0;
/// Shorter side at least, in pixels.
const SHORTER: f64 = 240.0;
/// Least width of the map, so that the title fits, in pixels.
const LEAST_WIDTH: i32 = 420;
/// Place of the list's discs behind the map, and of the names behind the discs, in pixels.
const DISC: i32 = 30;
const BEHIND_DISC: i32 = 16;
/// Least space between a name and its value, in pixels.
const BEFORE_VALUE: i32 = 20;
const LETTERS: i32 = 11;
/// Height of a line of the list, in pixels.
const NAME_HEIGHT: i32 = 22;
/// Longest list of names. A longer one would not fit.
const MOST_NAMES: usize = 40;
/// Longest name in the list, in letters: alone, and before a value.
const LONGEST_NAME: usize = 60;
const LANE_M: f64 = 3.2;

/// A light on the map. Its number is its place among the others.
pub(super) struct MapLight<'a> {
    pub(crate) name: &'a str,
    pub(crate) place_m: [f64; 2],
    pub(crate) colour: RGBColor,
    /// Words behind the name in the list.
    pub(crate) value: Option<String>,
}

/// The sheet of a map: the map at the left, and the names of the lights at the right unless there are too many.
pub(super) struct Sheet<'a> {
    lanes: &'a [Line],
    junctions: &'a [Line],
    lights: Vec<MapLight<'a>>,
    /// Western and northern ends of the net, in metres.
    corner_m: [f64; 2],
    px_per_m: f64,
    lane_px: f64,
    /// Width of the map and height of the sheet, in pixels.
    width: i32,
    pub(super) tall: i32,
    /// Width of the list of names in pixels, if there is one.
    names: Option<i32>,
}

impl<'a> Sheet<'a> {
    pub(super) fn around(lanes: &'a [Line], junctions: &'a [Line], lights: Vec<MapLight<'a>>) -> Sheet<'a> {
        let places = || lanes.iter().chain(junctions).flatten();
        let end =
            |axis: usize, pick: fn(f64, f64) -> f64, from: f64| places().map(|place| place[axis]).fold(from, pick);
        let [west, south] = [0, 1].map(|axis| end(axis, f64::min, f64::INFINITY));
        let [east, north] = [0, 1].map(|axis| end(axis, f64::max, f64::NEG_INFINITY));
        // A net without shapes is drawn as a point.
        let [wide_m, tall_m] = [east - west, north - south].map(|metres| if metres > 1.0 { metres } else { 1.0 });
        let px_per_m = LONGER / wide_m.max(tall_m);
        let [wide, tall] = [wide_m, tall_m].map(|metres| (metres * px_per_m).max(SHORTER).ceil() as i32);
        let names = (lights.len() <= MOST_NAMES).then(|| width_of_list(&lights));
        let listed = names.map_or(0, |_| NAME_HEIGHT * lights.len() as i32);
        Sheet {
            lanes,
            junctions,
            lights,
            corner_m: [west, north],
            px_per_m,
            lane_px: (LANE_M * px_per_m * 0.7).clamp(1.0, 6.0),
            width: wide.max(LEAST_WIDTH),
            tall: tall.max(listed),
            names,
        }
    }

    /// Returns the width and height of the picture, in pixels.
    pub(super) fn size(&self) -> (i32, i32) {
        (2 * MARGIN + self.right(), HEAD + MARGIN + self.tall + 24)
    }

    pub(super) fn right(&self) -> i32 {
        self.width + self.names.unwrap_or(0)
    }

    /// Draws the map, and its lights over what `between` draws. Each light has its name in the list.
    pub(super) fn draw(&self, area: &Area<'_>, between: impl FnOnce() -> Result<()>) -> Result<()> {
        for outline in self.junctions.iter().filter(|outline| outline.len() >= 3) {
            area.draw(&Polygon::new(self.line(outline), PALE.filled()))?;
        }
        self.draw_lanes(area, self.lanes, FAINT.mix(0.45))?;
        between()?;
        for (number, light) in self.lights.iter().enumerate() {
            draw_light(area, self.point(light.place_m), number, light.colour)?;
            if self.names.is_some() {
                let at = (px(self.width + DISC), px(10 + NAME_HEIGHT * number as i32));
                draw_light(area, at, number, light.colour)?;
                let behind = (at.0 + px(BEHIND_DISC), at.1);
                write_at(area, &light.in_list(), behind, LETTERS, (HPos::Left, VPos::Center))?;
                if let Some(value) = &light.value {
                    write_at(area, value, (px(self.right()), at.1), LETTERS, (HPos::Right, VPos::Center))?;
                }
            }
        }
        self.draw_scale(area)
    }

    pub(super) fn draw_lanes(&self, area: &Area<'_>, lanes: &[Line], colour: RGBAColor) -> Result<()> {
        for line in lanes.iter().filter(|line| line.len() >= 2) {
            area.draw(&PathElement::new(self.line(line), pen(colour, self.lane_px)))?;
        }
        Ok(())
    }

    pub(super) fn draw_cross(&self, area: &Area<'_>, place_m: [f64; 2]) -> Result<()> {
        area.draw(&Cross::new(self.point(place_m), px(5), pen(INK, 2)))?;
        Ok(())
    }

    /// Draws a line of a round number of metres under the map.
    fn draw_scale(&self, area: &Area<'_>) -> Result<()> {
        let fitting = (0..8).flat_map(|power| [1.0, 2.0, 5.0].map(|part| part * 10_f64.powi(power)));
        let metres = fitting.take_while(|metres| metres * self.px_per_m <= 160.0).last().unwrap_or(1.0);
        let (y, end) = (px(self.tall + 14), px(metres * self.px_per_m));
        area.draw(&PathElement::new([(0, y), (end, y)], pen(INK, 2)))?;
        write_at(area, &format!("{metres:.0} m"), (end + px(8), y), 11, (HPos::Left, VPos::Center))
    }

    fn point(&self, [x, y]: [f64; 2]) -> (i32, i32) {
        let [west, north] = self.corner_m;
        (px((x - west) * self.px_per_m), px((north - y) * self.px_per_m))
    }

    fn line(&self, line: &Line) -> Vec<(i32, i32)> {
        line.iter().map(|&place| self.point(place)).collect()
    }
}

impl MapLight<'_> {
    fn in_list(&self) -> String {
        shortened(self.name, LONGEST_NAME)
    }
}

/// Returns the width of the list of these lights, in pixels: as wide as its longest line.
fn width_of_list(lights: &[MapLight<'_>]) -> i32 {
    let width = |words: &str| text_width(words, f64::from(LETTERS)) / SCALE as i32;
    let names = lights.iter().map(|light| width(&light.in_list())).max().unwrap_or(0);
    let values = lights.iter().filter_map(|light| light.value.as_ref());
    let values = values.map(|value| BEFORE_VALUE + width(value)).max().unwrap_or(0);
    DISC + BEHIND_DISC + names + values
}

fn draw_light(area: &Area<'_>, at: (i32, i32), number: usize, colour: RGBColor) -> Result<()> {
    area.draw(&Circle::new(at, px(9), INK.filled()))?;
    area.draw(&Circle::new(at, px(8), colour.filled()))?;
    let middle = anchored(text(9, ink_over(colour)), HPos::Center, VPos::Center);
    area.draw_text(&number.to_string(), &middle, at)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn north_is_up_and_the_longer_side_fills_the_map() {
        let lanes = [vec![[0.0, 0.0], [1000.0, 0.0]], vec![[0.0, 500.0], [0.0, 0.0]]];
        let sheet = Sheet::around(&lanes, &[], Vec::new());
        // 1000 m are 1000 pixels.
        assert_eq!([sheet.point([0.0, 500.0]), sheet.point([1000.0, 0.0])], [(0, 0), (px(1000), px(500))]);
    }
}
