//! A map of a road network with the return of every agent at the place of its light.

use anyhow::Result;

use super::net_map::{MapLight, Sheet};
use super::returns_map::{Returns, SCALE, draw_scale};
use super::*;
use dials_core::domain::road_trace::RoadMap;

/// Draws the lights on the roads, each in the shade of its return. The list at the right has the numbers.
pub(super) fn returns_on_net(
    map: &RoadMap,
    names: &[String],
    returns: &Returns,
    title: &str,
    about: &str,
) -> Result<Svg> {
    let lights = names.iter().zip(&map.lights_m).zip(&returns.means).map(|((name, &place_m), &mean)| MapLight {
        name,
        place_m,
        colour: shade(returns.share(mean)),
        value: Some(returns.written(mean)),
    });
    let lights: Vec<MapLight> = lights.collect();
    let sheet = Sheet::around(&map.lanes, &map.junctions, &lights);
    let (width, height) = sheet.size();
    picture((width + SCALE, height), title, about, |area| {
        sheet.draw_junctions(area, &map.junctions)?;
        sheet.draw_net(area, &map.lanes)?;
        sheet.draw_lights(area, &lights)?;
        sheet.draw_scale(area)?;
        draw_scale(area, px(sheet.right() + 24), px(sheet.tall().min(300)), returns)?;
        area.draw_text("sum of rewards over an episode", &text(10, FAINT), (px(300), px(sheet.tall() + 8)))?;
        Ok(())
    })
}
