//! Signal timing: which direction has green when, one bar per intersection.

use anyhow::Result;

use super::*;
use crate::domain::road_trace::{RoadTrace, Shown};

const WIDTH: i32 = 1100;
const AROUND: i32 = HEAD + MARGIN + LEGEND + AXIS;
const LEGEND: i32 = 26;
const AXIS: i32 = 44;

/// Draws one bar per intersection, with agent 0 at the bottom as on the map.
pub fn signal_timing(trace: &RoadTrace, about: &About) -> Result<Svg> {
    let seconds = trace.seconds as f64;
    let count = trace.names.len();
    let bar_height: i32 = if count <= 25 { 24 } else { 14 };
    let title = match count {
        1 => "Signal timing of one intersection".to_owned(),
        count => format!("Signal timing of the {count} intersections of a grid of {}", trace.grid()),
    };
    let size = (WIDTH, AROUND + bar_height * count as i32);
    picture(size, &title, &about.of_episode(), |area| {
        let (legend, area) = area.split_vertically(px(LEGEND));
        let mut chart = ChartBuilder::on(&area)
            .x_label_area_size(px(AXIS))
            .y_label_area_size(px(58))
            .margin_right(px(10))
            .build_cartesian_2d(BoundedAxis::from(0.0..seconds), BoundedAxis::from(0.0..count as f64))?;
        draw_axes(&mut chart, "", 0, true)?;
        let (left, top) = area.get_base_pixel();
        for (agent, (name, shown)) in trace.names.iter().zip(&trace.lights).enumerate() {
            let middle = agent as f64 + 0.5;
            let mut from = 0;
            for phase in shown.chunk_by(|a, b| a == b) {
                let to = from + phase.len();
                let bar = [(from as f64, middle - 0.38), (to as f64, middle + 0.38)];
                chart.draw_series([Rectangle::new(bar, colour(phase[0]).filled())])?;
                from = to;
            }
            let place = chart.backend_coord(&(0.0, middle));
            let style = anchored(text(bar_height.min(14) - 3, INK), HPos::Right, VPos::Center);
            area.draw_text(name, &style, (place.0 - left - px(6), place.1 - top))?;
        }
        draw_legend(&legend, &trace.greens)
    })
}

/// Colours of the directions that can have green. The first two and yellow also differ when printed in grey.
const GREENS: [RGBColor; 4] = [BLUE, RGBColor(170, 214, 240), GREEN, PURPLE];

fn colour(shown: Shown) -> RGBColor {
    match shown {
        Shown::Green(number) => GREENS[number % GREENS.len()],
        Shown::Yellow => ORANGE,
        Shown::Other => FAINT,
    }
}

fn draw_legend(area: &Area<'_>, greens: &[&str]) -> Result<()> {
    let greens = greens.iter().enumerate().map(|(number, &word)| (Shown::Green(number), word));
    let style = anchored(text(11, INK), HPos::Left, VPos::Center);
    for (number, (shown, word)) in greens.chain([(Shown::Yellow, "yellow")]).enumerate() {
        let x = 58 + 230 * number as i32;
        area.draw(&Rectangle::new([(px(x), px(4)), (px(x + 26), px(16))], colour(shown).filled()))?;
        area.draw_text(word, &style, (px(x + 34), px(10)))?;
    }
    Ok(())
}
