//! Signal timing: which direction has green when, one bar per intersection.

use anyhow::Result;

use super::*;
use crate::drawing::SCALE;
use dials_core::domain::road_trace::{RoadTrace, Shown};

/// Number of bars from which on the time axis stands above them, too.
const MANY: usize = 26;
const AROUND: i32 = HEAD + MARGIN + LEGEND + AXIS;
const LEGEND: i32 = 26;
const AXIS: i32 = 44;
const LONGEST_NAME: usize = 60;
/// Width in pixels for names. Longer ones make the picture wider.
const NAMES: i32 = 250;

/// Draws one bar per intersection, with agent 0 at the bottom as on the map.
pub fn signal_timing(trace: &RoadTrace, about: &About) -> Result<Svg> {
    let count = trace.names.len();
    let bar_height: i32 = if count <= 25 { 24 } else { 14 };
    let title = match count {
        1 => "Signal timing of one intersection".to_owned(),
        count => format!("Signal timing of the {count} intersections of {}", trace.place()),
    };
    let names: Vec<String> = trace.names.iter().map(|name| shortened(name, LONGEST_NAME)).collect();
    let letters = f64::from(bar_height.min(14) - 3);
    let widest = names.iter().map(|name| text_width(name, letters)).max().unwrap_or(0);
    let above = if count >= MANY { AXIS } else { 0 };
    let wider = (widest / SCALE as i32 - NAMES).max(0);
    let size = (width_for(&trace.seconds) + wider, AROUND + above + bar_height * count as i32);
    picture(size, &title, &about.of_episode(), |area| {
        let (legend, area) = area.split_vertically(px(LEGEND));
        let mut chart = ChartBuilder::on(&area)
            .x_label_area_size(px(AXIS))
            .top_x_label_area_size(px(above))
            .y_label_area_size(px(58).max(widest + px(10)))
            .margin_right(px(10))
            .build_cartesian_2d(time_axis(&trace.seconds), BoundedAxis::from(0.0..count as f64))?;
        draw_axes(&mut chart, "", 0, true)?;
        let (left, top) = area.get_base_pixel();
        for (agent, (name, shown)) in names.iter().zip(&trace.lights).enumerate() {
            let middle = agent as f64 + 0.5;
            let mut from = trace.seconds.start;
            for phase in shown.chunk_by(|a, b| a == b) {
                let to = from + phase.len();
                let bar = [(from as f64, middle - 0.38), (to as f64, middle + 0.38)];
                chart.draw_series([Rectangle::new(bar, colour(phase[0]).filled())])?;
                from = to;
            }
            let place = chart.backend_coord(&(trace.seconds.start as f64, middle));
            write_at(&area, name, (place.0 - left - px(6), place.1 - top), letters, (HPos::Right, VPos::Center))?;
        }
        draw_legend(&legend, trace)
    })
}

/// Colours of the greens. The first two and yellow also differ when printed in grey. Further greens begin again.
const GREENS: [RGBColor; 8] = [
    BLUE,
    RGBColor(170, 214, 240),
    GREEN,
    PURPLE,
    RGBColor(166, 219, 190),
    RGBColor(84, 39, 136),
    RGBColor(140, 109, 70),
    RGBColor(8, 48, 107),
];

fn colour(shown: Shown) -> RGBColor {
    match shown {
        Shown::Green(number) => GREENS[number % GREENS.len()],
        Shown::Yellow => ORANGE,
        Shown::Other => FAINT,
    }
}

fn draw_legend(area: &Area<'_>, trace: &RoadTrace) -> Result<()> {
    let greens = trace.greens.iter().enumerate().map(|(number, word)| (Shown::Green(number), word.as_str()));
    let mut words: Vec<(Shown, &str)> = greens.take(GREENS.len()).chain([(Shown::Yellow, "yellow")]).collect();
    if trace.lights.iter().flatten().any(|&shown| shown == Shown::Other) {
        words.push((Shown::Other, "all red or other"));
    }
    // Each word takes only its own room: a light may have eight greens.
    let mut x = px(58);
    for (shown, word) in words {
        area.draw(&Rectangle::new([(x, px(4)), (x + px(26), px(16))], colour(shown).filled()))?;
        write_at(area, word, (x + px(34), px(10)), 11, (HPos::Left, VPos::Center))?;
        x += px(50) + text_width(word, 11.0);
    }
    Ok(())
}
