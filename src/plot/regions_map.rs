//! A map of a road network with the local regions of its lights.

use anyhow::Result;

use super::*;
use crate::drawing::VERMILLION;

/// A line in metres, east and north.
pub type Line = Vec<[f64; 2]>;

/// What the map shows.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionsMap {
    /// Name of the network.
    pub subject: String,
    /// Outlines of the junctions; some may be empty.
    pub junctions: Vec<Line>,
    /// All lanes for cars, in the direction of driving.
    pub lanes: Vec<Line>,
    /// Regions of the lights that learn.
    pub regions: Vec<MapRegion>,
    /// Places of the lights that keep their program.
    pub keeping: Vec<[f64; 2]>,
}

/// The region of one light.
#[derive(Clone, Debug, PartialEq)]
pub struct MapRegion {
    /// Name of the light.
    pub name: String,
    pub place_m: [f64; 2],
    /// Lanes on which cars come to the light.
    pub approaches: Vec<Line>,
    /// All lanes of its roads.
    pub lanes: Vec<Line>,
}

/// Colours of the regions.
const COLOURS: [RGBColor; 6] = [BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY];
/// Longer side of the map in pixels.
const LONGER: f64 = 1000.0;
/// Shorter side at least, in pixels.
const SHORTER: f64 = 240.0;
/// Width of the list of names, in pixels.
const NAMES: i32 = 330;
/// Longest list of names. A longer one would not fit.
const MOST_NAMES: usize = 40;
/// Longest name in the list, in letters.
const LONGEST_NAME: usize = 38;
/// Width of a lane in metres.
const LANE_M: f64 = 3.2;

/// Draws the lanes: grey, in a pale colour if they are in a region, in full colour if cars on them come to its light.
pub fn regions_map(map: &RegionsMap) -> Result<Svg> {
    let frame = Frame::around(map);
    let names = map.regions.len() <= MOST_NAMES;
    let (width, height) = (frame.width.ceil() as i32, frame.height.ceil() as i32);
    let list = if names { NAMES } else { 0 };
    let tall = height.max(if names { 22 * map.regions.len() as i32 } else { 0 });
    let title = format!("Lights and their regions: {}", map.subject);
    let about = format!(
        "{} learn (numbers), {} keep their program (crosses); full colour: approaches, pale: other roads of the region",
        map.regions.len(),
        map.keeping.len()
    );
    let colours = colours(&map.regions);
    let size = (2 * MARGIN + width.max(420) + list, HEAD + MARGIN + tall + 24);
    picture(size, &title, &about, |area| {
        for outline in map.junctions.iter().filter(|outline| outline.len() >= 3) {
            area.draw(&Polygon::new(frame.line(outline), PALE.filled()))?;
        }
        let draw = |lines: &[Line], colour: RGBAColor| -> Result<()> {
            for line in lines.iter().filter(|line| line.len() >= 2) {
                area.draw(&PathElement::new(frame.line(line), pen(colour, frame.lane_px)))?;
            }
            Ok(())
        };
        draw(&map.lanes, FAINT.mix(0.45))?;
        let coloured = || map.regions.iter().zip(&colours);
        for (region, colour) in coloured() {
            draw(&region.lanes, colour.mix(0.35))?;
        }
        for (region, colour) in coloured() {
            draw(&region.approaches, colour.mix(1.0))?;
        }
        for place in &map.keeping {
            area.draw(&Cross::new(frame.point(*place), px(5), pen(INK, 2)))?;
        }
        for (number, (region, colour)) in coloured().enumerate() {
            let at = frame.point(region.place_m);
            draw_light(area, at, number, *colour)?;
            if names {
                let at = (px(width.max(420) + 30), px(10 + 22 * number as i32));
                draw_light(area, at, number, *colour)?;
                let style = anchored(text(11, INK), HPos::Left, VPos::Center);
                area.draw_text(&shortened(&region.name), &style, (at.0 + px(16), at.1))?;
            }
        }
        draw_scale(area, &frame, tall)
    })
}

/// Returns a colour for each region: the one whose regions so far are the furthest away.
fn colours(regions: &[MapRegion]) -> Vec<RGBColor> {
    let mut nearest = vec![[f64::INFINITY; COLOURS.len()]; regions.len()];
    let mut colours = Vec::with_capacity(regions.len());
    for (number, region) in regions.iter().enumerate() {
        let furthest =
            (0..COLOURS.len()).rev().max_by(|&one, &other| nearest[number][one].total_cmp(&nearest[number][other]));
        let colour = furthest.expect("there are colours");
        colours.push(COLOURS[colour]);
        for (other, nearest) in regions.iter().zip(&mut nearest) {
            let [east, north] = [0, 1].map(|axis| other.place_m[axis] - region.place_m[axis]);
            nearest[colour] = nearest[colour].min(east.hypot(north));
        }
    }
    colours
}

/// Draws a light as a disc with its agent's number.
fn draw_light(area: &Area<'_>, at: (i32, i32), number: usize, colour: RGBColor) -> Result<()> {
    area.draw(&Circle::new(at, px(9), INK.filled()))?;
    area.draw(&Circle::new(at, px(8), colour.filled()))?;
    let middle = anchored(text(9, ink_over(colour)), HPos::Center, VPos::Center);
    area.draw_text(&number.to_string(), &middle, at)?;
    Ok(())
}

/// Draws a line of a round number of metres under the map.
fn draw_scale(area: &Area<'_>, frame: &Frame, tall: i32) -> Result<()> {
    let fitting = (0..8).flat_map(|power| [1.0, 2.0, 5.0].map(|part| part * 10_f64.powi(power)));
    let metres = fitting.take_while(|metres| metres * frame.px_per_m <= 160.0).last().unwrap_or(1.0);
    let y = px(tall + 14);
    let end = px(metres * frame.px_per_m);
    area.draw(&PathElement::new([(0, y), (end, y)], pen(INK, 2)))?;
    let style = anchored(text(11, INK), HPos::Left, VPos::Center);
    area.draw_text(&format!("{metres:.0} m"), &style, (end + px(8), y))?;
    Ok(())
}

/// Where a place of the net is on the map.
struct Frame {
    /// Western and northern ends, in metres.
    corner_m: [f64; 2],
    px_per_m: f64,
    width: f64,
    height: f64,
    /// Width of a lane in pixels.
    lane_px: f64,
}

impl Frame {
    fn around(map: &RegionsMap) -> Frame {
        let places = || map.lanes.iter().chain(&map.junctions).flatten();
        let end =
            |axis: usize, pick: fn(f64, f64) -> f64, from: f64| places().map(|place| place[axis]).fold(from, pick);
        let [west, south] = [0, 1].map(|axis| end(axis, f64::min, f64::INFINITY));
        let [east, north] = [0, 1].map(|axis| end(axis, f64::max, f64::NEG_INFINITY));
        // A net without shapes is drawn as a point.
        let [wide, tall] = [east - west, north - south].map(|metres| if metres > 1.0 { metres } else { 1.0 });
        let px_per_m = LONGER / wide.max(tall);
        Frame {
            corner_m: [west, north],
            px_per_m,
            width: (wide * px_per_m).max(SHORTER),
            height: (tall * px_per_m).max(SHORTER),
            lane_px: (LANE_M * px_per_m * 0.7).clamp(1.0, 6.0),
        }
    }

    fn point(&self, [x, y]: [f64; 2]) -> (i32, i32) {
        let [west, north] = self.corner_m;
        (px((x - west) * self.px_per_m), px((north - y) * self.px_per_m))
    }

    fn line(&self, line: &Line) -> Vec<(i32, i32)> {
        line.iter().map(|&place| self.point(place)).collect()
    }
}

fn shortened(name: &str) -> String {
    match name.char_indices().nth(LONGEST_NAME) {
        Some((end, _)) => format!("{}...", &name[..end]),
        None => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(name: &str, place_m: [f64; 2]) -> MapRegion {
        let approach = vec![[place_m[0] - 100.0, place_m[1]], place_m];
        MapRegion { name: name.to_owned(), place_m, approaches: vec![approach.clone()], lanes: vec![approach] }
    }

    #[test]
    fn neighbours_have_different_colours() {
        let regions: Vec<MapRegion> =
            (0..9).map(|number| region("a", [f64::from(number % 3) * 100.0, f64::from(number / 3) * 100.0])).collect();
        let colours = colours(&regions);
        for (one, other) in [(0, 1), (1, 2), (0, 3), (3, 4), (4, 5), (4, 7), (7, 8), (5, 8), (6, 7), (3, 6)] {
            assert_ne!(colours[one], colours[other], "{one} and {other}");
        }
    }

    #[test]
    fn north_is_up_and_every_light_has_its_number_and_its_name() {
        let map = RegionsMap {
            subject: "town".to_owned(),
            junctions: vec![vec![], vec![[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]]],
            lanes: vec![vec![[0.0, 0.0], [1000.0, 0.0]], vec![[0.0, 500.0], [0.0, 0.0]]],
            regions: vec![region("first", [100.0, 0.0]), region(&"x".repeat(50), [1000.0, 400.0])],
            keeping: vec![[500.0, 500.0]],
        };
        let frame = Frame::around(&map);
        // 1000 m are 1000 pixels.
        assert_eq!([frame.point([0.0, 500.0]), frame.point([1000.0, 0.0])], [(0, 0), (px(1000), px(500))]);
        let svg = regions_map(&map).unwrap().file();
        for part in [
            ">\nfirst\n".to_owned(),
            format!(">\n{}...\n", "x".repeat(38)),
            "2 learn (numbers), 1 keep their program (crosses)".to_owned(),
            ">\n100 m\n".to_owned(),
        ] {
            assert!(svg.contains(&part), "{part}\n{svg}");
        }
    }

    #[test]
    fn a_net_without_shapes_has_a_map_too() {
        let map = RegionsMap {
            subject: String::new(),
            junctions: Vec::new(),
            lanes: vec![Vec::new()],
            regions: vec![region("a", [0.0, 0.0])],
            keeping: Vec::new(),
        };
        regions_map(&map).unwrap();
    }
}
