//! Queues: standing cars per approach over time.

use anyhow::Result;

use super::*;
use dials_core::domain::road_trace::{Approach, RoadTrace};

const HEIGHT: i32 = 690;
/// Height below each panel, and of the time axis below the last one, in pixels.
const GAP: i32 = 6;
const TIMES: i32 = 34;

/// Draws the standing cars, one panel per approach: the mean over all intersections, and the longest queue.
pub fn queues(trace: &RoadTrace, about: &About) -> Result<Svg> {
    let seconds = &trace.seconds;
    let standing = || trace.approaches.iter().flat_map(|approach| &approach.standing);
    let longest = standing().flatten().copied().max().unwrap_or(0).max(1);

    let title = match &trace.names[..] {
        [only] => format!("Queues at {only}"),
        names => format!("Queues at the {} intersections of {}", names.len(), trace.place()),
    };
    picture((width_for(seconds), HEIGHT), &title, &about.of_episode(), |area| {
        let (legend, area) = area.split_vertically(px(26));
        let several = trace.names.len() > 1;
        draw_legend(&legend, several)?;
        let panels = panels(&area, trace.approaches.len());
        for (number, (Approach { from, standing }, panel)) in trace.approaches.iter().zip(&panels).enumerate() {
            let of_step = |step: usize| standing.iter().map(move |queue| queue[step]);
            let means: Vec<f64> =
                (0..seconds.len()).map(|step| of_step(step).sum::<usize>() as f64 / standing.len() as f64).collect();
            let most: Vec<f64> = (0..seconds.len()).map(|step| of_step(step).max().unwrap_or(0) as f64).collect();
            let last = number + 1 == panels.len();
            let mut chart = ChartBuilder::on(panel)
                .margin_top(px(18))
                .x_label_area_size(px(if last { GAP + TIMES } else { GAP }))
                .y_label_area_size(px(58))
                .margin_right(px(10))
                .build_cartesian_2d(time_axis(seconds), BoundedAxis::from(0.0..longest as f64 + 0.5))?;
            draw_axes(&mut chart, "cars", 4, last)?;
            chart.draw_series(AreaSeries::new(stairs(seconds.start, &means), 0.0, SKY.mix(0.55)))?;
            chart.draw_series(LineSeries::new(stairs(seconds.start, &means), pen(BLUE, 2)))?;
            if several {
                chart.draw_series(LineSeries::new(stairs(seconds.start, &most), pen(FAINT, 1)))?;
            }
            let mean = means.iter().sum::<f64>() / seconds.len().max(1) as f64;
            let word = format!("from the {from}: {mean:.2} cars on average");
            write(panel, &word, (px(62), px(1)), 11)?;
        }
        Ok(())
    })
}

/// Splits the picture so that a car is as high in all panels. The last one has the time axis on top of that.
fn panels<'a>(area: &Area<'a>, count: usize) -> Vec<Area<'a>> {
    let height = (area.dim_in_pixel().1 as i32 - px(TIMES)) / count.max(1) as i32;
    let ends: Vec<i32> = (1..count as i32).map(|number| number * height).collect();
    area.split_by_breakpoints::<i32, i32, _, _>([], &ends)
}

fn draw_legend(area: &Area<'_>, several: bool) -> Result<()> {
    let mean = if several { "standing cars, mean over the intersections" } else { "standing cars" };
    area.draw(&Rectangle::new([(px(58), px(10)), (px(84), px(16))], SKY.mix(0.55).filled()))?;
    area.draw(&PathElement::new(vec![(px(58), px(10)), (px(84), px(10))], pen(BLUE, 2)))?;
    write_at(area, mean, (px(92), px(11)), 11, (HPos::Left, VPos::Center))?;
    if several {
        area.draw(&PathElement::new(vec![(px(410), px(11)), (px(436), px(11))], pen(FAINT, 1)))?;
        write_at(area, "the longest queue", (px(444), px(11)), 11, (HPos::Left, VPos::Center))?;
    }
    Ok(())
}

/// Returns the corners of a line on which each value holds for one second, from the second `begin` on.
fn stairs(begin: usize, values: &[f64]) -> Vec<(f64, f64)> {
    let step = |(second, &value): (usize, &f64)| [(second as f64, value), ((second + 1) as f64, value)];
    (begin..).zip(values).flat_map(step).collect()
}
