//! Space and time: the cars of one corridor as lines, the lights on their way as bars.

use anyhow::Result;

use super::*;
use dials_core::domain::road_trace::{Aspect, Corridor};

/// Height per edge between two lights, in pixels, and of a metre of the corridor. The larger one counts.
const EDGE_HEIGHT: i32 = 105;
const METRE: f64 = 0.5;
/// Largest height of the chart that metres can ask for, in pixels.
const TALLEST: f64 = 1000.0;
const LONGEST_NAME: usize = 20;
const AROUND: i32 = HEAD + 110;

/// Draws the cars that drove through a corridor, each a line: steep if it is fast, flat if it waits. At each stop line
/// a bar shows the light; a thicker one lets fewer cars through. `seconds`: those of the episode that are shown.
pub fn space_time(corridor: &Corridor, seconds: &Range<usize>, about: &About) -> Result<Svg> {
    let Corridor { name, from, to, length_m, crossings, cars } = corridor;
    let width = width_for(seconds);
    let [first, last] = [seconds.start, seconds.end].map(|second| second as f64);
    let title = format!("Space and time: {name}, from {from} to {to}");
    let chart_px = (EDGE_HEIGHT * (crossings.len() as i32 + 1)).max((length_m * METRE).min(TALLEST) as i32);
    let m_per_px = length_m / f64::from(chart_px);
    let names: Vec<String> = crossings.iter().map(|crossing| shortened(&crossing.name, LONGEST_NAME)).collect();
    let widest = names.iter().map(|name| text_width(name, 11.0)).max().unwrap_or(0);
    picture((width, AROUND + chart_px), &title, &about.of_episode(), |area| {
        let (legend, area) = area.split_vertically(px(24));
        let mut chart = ChartBuilder::on(&area)
            .x_label_area_size(px(44))
            .y_label_area_size(px(58))
            .margin_right(px(48).max(widest + px(14)))
            .build_cartesian_2d(time_axis(seconds), BoundedAxis::from(0.0..*length_m))?;
        // Shade the inside of the intersections, so that the stop lines are visible.
        for (crossing, name) in crossings.iter().zip(&names) {
            let (from, to) = (crossing.begin_m, crossing.end_m);
            chart.draw_series([Rectangle::new([(first, from), (last, to)], PALE.filled())])?;
            let place = chart.backend_coord(&(last, (from + to) / 2.0));
            let (x, y) = area.get_base_pixel();
            write_at(&area, name, (place.0 - x + px(8), place.1 - y), 11, (HPos::Left, VPos::Center))?;
        }
        draw_axes(&mut chart, &format!("distance from the {from} end (m)"), 8, true)?;
        for places in cars {
            chart.draw_series(LineSeries::new(places.iter().copied(), pen(INK, 1)))?;
        }
        for crossing in crossings {
            let (stop_line_m, mut begin) = (crossing.begin_m, seconds.start);
            for phase in crossing.aspects.chunk_by(|a, b| a == b) {
                let ((height, colour), end) = (bar(phase[0]), begin + phase.len());
                let bar = [(begin as f64, stop_line_m), (end as f64, stop_line_m + height * m_per_px)];
                chart.draw_series([Rectangle::new(bar, colour.filled())])?;
                begin = end;
            }
        }
        draw_legend(&legend)
    })
}

/// Returns the height of a light's bar, in pixels, and its colour.
fn bar(aspect: Aspect) -> (f64, RGBColor) {
    match aspect {
        Aspect::Green => (5.0, RGBColor(90, 190, 130)),
        Aspect::Yellow => (8.0, RGBColor(240, 190, 40)),
        Aspect::Red => (11.0, RGBColor(178, 24, 43)),
    }
}

fn draw_legend(area: &Area<'_>) -> Result<()> {
    let label = |words, x: i32| write_at(area, words, (px(x), px(10)), 11, (HPos::Left, VPos::Center));
    area.draw(&PathElement::new(vec![(px(58), px(10)), (px(84), px(10))], pen(INK, 1)))?;
    label("a car", 92)?;
    let lights = [(Aspect::Green, "green"), (Aspect::Yellow, "yellow"), (Aspect::Red, "red at the stop line")];
    for (number, (aspect, word)) in lights.into_iter().enumerate() {
        let (height, colour) = bar(aspect);
        let x = 158 + 100 * number as i32;
        area.draw(&Rectangle::new([(px(x), px(15 - height as i32)), (px(x + 26), px(15))], colour.filled()))?;
        label(word, x + 34)?;
    }
    area.draw(&Rectangle::new([(px(548), px(4)), (px(574), px(15))], PALE.filled()))?;
    label("inside of an intersection", 582)
}
