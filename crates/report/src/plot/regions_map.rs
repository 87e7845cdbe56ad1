//! A map of a road network with the local regions of its lights.

use anyhow::Result;

use super::net_map::{MapLight, Sheet};
use super::*;
use crate::drawing::VERMILLION;
use dials_core::domain::road_trace::Line;

pub struct RegionsMap {
    pub subject: String,
    /// Outlines of the junctions; some may be empty.
    pub junctions: Vec<Line>,
    /// All lanes for cars, in the direction of driving.
    pub lanes: Vec<Line>,
    pub regions: Vec<MapRegion>,
    /// Places of the lights that keep their program.
    pub keeping: Vec<[f64; 2]>,
}

pub struct MapRegion {
    pub name: String,
    pub place_m: [f64; 2],
    /// Lanes on which cars come to the light.
    pub approaches: Vec<Line>,
    pub lanes: Vec<Line>,
}

const COLOURS: [RGBColor; 6] = [BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY];

/// Draws the lanes: grey, in a pale colour if they are in a region, in full colour if cars on them come to its light.
pub fn regions_map(map: &RegionsMap) -> Result<Svg> {
    let title = format!("Lights and their regions: {}", map.subject);
    let about = format!(
        "{} learn (numbers), {} keep their program (crosses); full colour: approaches, pale: other roads of the region",
        map.regions.len(),
        map.keeping.len()
    );
    let colours = colours(&map.regions);
    let coloured = || map.regions.iter().zip(&colours);
    let lights = coloured().map(|(region, &colour)| MapLight {
        name: &region.name,
        place_m: region.place_m,
        colour,
        value: None,
    });
    let sheet = Sheet::around(&map.lanes, &map.junctions, lights.collect());
    picture(sheet.size(), &title, &about, |area| {
        sheet.draw(area, || {
            for (region, colour) in coloured() {
                sheet.draw_lanes(area, &region.lanes, colour.mix(0.35))?;
            }
            for (region, colour) in coloured() {
                sheet.draw_lanes(area, &region.approaches, colour.mix(1.0))?;
            }
            map.keeping.iter().try_for_each(|&place_m| sheet.draw_cross(area, place_m))
        })
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
    fn a_net_without_shapes_has_a_map_too() {
        let [subject, name] = [String::new(), "x".repeat(80)];
        let regions = vec![region(&name, [0.0, 0.0])];
        let map = RegionsMap { subject, junctions: vec![vec![]], lanes: vec![vec![]], regions, keeping: vec![] };
        let svg = regions_map(&map).unwrap().file();
        assert!(svg.contains("xxx...xxx") && !svg.contains(&"x".repeat(80)), "a long name is cut in the middle: {svg}");
    }
}
