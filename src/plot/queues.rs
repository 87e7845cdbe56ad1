//! Queues: cars that stand, per approach, over time.

use anyhow::Result;

use super::*;
use crate::traffic::grid::{Side, lane};
use crate::traffic::recording::Recording;

/// A car slower than this stands: SUMO's own limit for "halting".
const STANDING_BELOW_MPS: f64 = 0.1;

const SIZE: (u32, u32) = (1100, 660);

/// Cars standing on the approaches from west, south, east and north: mean over all intersections, and the longest queue.
pub fn queues(recording: &Recording, about: &About) -> Result<String> {
    let grid = recording.roads.grid;
    let agents = grid.agents();
    let steps = recording.steps.len();
    // Per side: of every agent, of every step.
    let mut standing = vec![vec![Vec::with_capacity(steps); agents.len()]; Side::ALL.len()];
    for &agent in &agents {
        for (side, edge) in grid.incoming_edges(agent).iter().enumerate() {
            let queue = recording
                .on_lane(&lane(edge))?
                .map(|cars| cars.speeds_mps.iter().filter(|&&speed| speed < STANDING_BELOW_MPS).count());
            standing[side][agent.0].extend(queue);
        }
    }
    let longest = standing.iter().flatten().flatten().copied().max().unwrap_or(0).max(1);

    let title = match agents[..] {
        [only] => format!("Queues at {}", grid.light(only)),
        _ => format!("Queues on a grid of {grid}: mean over its {} intersections, and the longest", agents.len()),
    };
    picture(SIZE, &title, &about.of_episode(), |area| {
        let panels = area.split_evenly((Side::ALL.len(), 1));
        for ((side, panel), queues) in Side::ALL.into_iter().zip(&panels).zip(&standing) {
            let of_step = |step: usize| queues.iter().map(move |queue| queue[step]);
            let means: Vec<f64> =
                (0..steps).map(|step| of_step(step).sum::<usize>() as f64 / agents.len() as f64).collect();
            let most: Vec<f64> = (0..steps).map(|step| of_step(step).max().unwrap_or(0) as f64).collect();
            let last = side == Side::North;
            let mut chart = ChartBuilder::on(panel)
                .margin_top(16)
                .x_label_area_size(if last { 40 } else { 6 })
                .y_label_area_size(58)
                .margin_right(10)
                .build_cartesian_2d(0.0..steps as f64, 0.0..longest as f64 + 0.5)?;
            chart
                .configure_mesh()
                .disable_x_mesh()
                .light_line_style(TRANSPARENT)
                .bold_line_style(PALE)
                .x_labels(if last { 11 } else { 0 })
                .x_desc(if last { "time (s)" } else { "" })
                .y_labels(4)
                .y_label_formatter(&|cars| format!("{cars:.0}"))
                .y_desc("cars")
                .axis_desc_style(type_of(14, INK))
                .label_style(type_of(13, INK))
                .axis_style(FAINT)
                .draw()?;
            chart.draw_series(AreaSeries::new(stairs(&means), 0.0, SKY.mix(0.55)))?;
            chart.draw_series(LineSeries::new(stairs(&means), BLUE.stroke_width(2)))?;
            if agents.len() > 1 {
                chart.draw_series(LineSeries::new(stairs(&most), FAINT.stroke_width(1)))?;
            }
            let mean = means.iter().sum::<f64>() / steps.max(1) as f64;
            let word = format!("from the {}: {mean:.2} cars on average", name(side));
            panel.draw_text(&word, &type_of(13, INK), (62, 0))?;
        }
        Ok(())
    })
}

/// A value holds for a second.
fn stairs(values: &[f64]) -> Vec<(f64, f64)> {
    let step = |(second, &value): (usize, &f64)| [(second as f64, value), ((second + 1) as f64, value)];
    values.iter().enumerate().flat_map(step).collect()
}

fn name(side: Side) -> &'static str {
    match side {
        Side::West => "west",
        Side::South => "south",
        Side::East => "east",
        Side::North => "north",
    }
}
