//! Signal timing: who has green when, one bar per intersection.

use anyhow::Result;

use super::*;
use crate::traffic::agents::phases::Light;
use crate::traffic::sim::recording::Recording;

const WIDTH: i32 = 1100;
const AROUND: i32 = HEAD + MARGIN + LEGEND + AXIS;
const LEGEND: i32 = 26;
const AXIS: i32 = 44;

/// One bar per intersection, agent 0 at the bottom as on the map.
pub fn signal_timing(recording: &Recording, about: &About) -> Result<Svg> {
    let grid = recording.roads.grid;
    let agents = grid.agents();
    let seconds = recording.steps.len() as f64;
    let bar_height: i32 = if agents.len() <= 25 { 24 } else { 14 };
    let title = match agents.len() {
        1 => "Signal timing of one intersection".to_owned(),
        count => format!("Signal timing of the {count} intersections of a grid of {grid}"),
    };
    let size = (WIDTH, AROUND + bar_height * agents.len() as i32);
    picture(size, &title, &about.of_episode(), |area| {
        let (legend, area) = area.split_vertically(px(LEGEND));
        let mut chart = ChartBuilder::on(&area)
            .x_label_area_size(px(AXIS))
            .y_label_area_size(px(58))
            .margin_right(px(10))
            .build_cartesian_2d(0.0..seconds, 0.0..agents.len() as f64)?;
        draw_axes(&mut chart, "", 0, true)?;
        let (left, top) = area.get_base_pixel();
        for &agent in &agents {
            let middle = agent.0 as f64 + 0.5;
            let shown: Vec<_> = recording.steps.iter().map(|step| &step.signals[agent.0]).collect();
            let mut from = 0;
            for phase in shown.chunk_by(|a, b| a == b) {
                let to = from + phase.len();
                let bar = [(from as f64, middle - 0.38), (to as f64, middle + 0.38)];
                chart.draw_series([Rectangle::new(bar, colour(Light::of(phase[0])).filled())])?;
                from = to;
            }
            let place = chart.backend_coord(&(0.0, middle));
            let style = anchored(text(bar_height.min(14) - 3, INK), HPos::Right, VPos::Center);
            area.draw_text(&grid.light(agent), &style, (place.0 - left - px(6), place.1 - top))?;
        }
        draw_legend(&legend)
    })
}

/// Dark, light and bright: three shades of grey, too.
fn colour(light: Option<Light>) -> RGBColor {
    match light {
        Some(Light::VerticalGreen) => BLUE,
        Some(Light::HorizontalGreen) => RGBColor(170, 214, 240),
        Some(Light::VerticalYellow | Light::HorizontalYellow) => ORANGE,
        None => FAINT,
    }
}

fn draw_legend(area: &Area<'_>) -> Result<()> {
    let words = [
        (Light::VerticalGreen, "green for south and north"),
        (Light::HorizontalGreen, "green for west and east"),
        (Light::VerticalYellow, "yellow"),
    ];
    let style = anchored(text(11, INK), HPos::Left, VPos::Center);
    for (number, (light, word)) in words.into_iter().enumerate() {
        let x = 58 + 230 * number as i32;
        area.draw(&Rectangle::new([(px(x), px(4)), (px(x + 26), px(16))], colour(Some(light)).filled()))?;
        area.draw_text(word, &style, (px(x + 34), px(10)))?;
    }
    Ok(())
}
