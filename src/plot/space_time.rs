//! Space and time: the cars of one corridor as lines, the lights they meet as bars.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};

use super::*;
use crate::base::AgentId;
use crate::traffic::paper_grid::grid::lane;
use crate::traffic::side::Side;
use crate::traffic::sim::recording::Recording;

const WIDTH: i32 = 1100;
/// Pixels per edge of the corridor, and of what is around the chart.
const EDGE_HEIGHT: i32 = 105;
const AROUND: i32 = HEAD + 110;

/// The cars that drive through row `row` of the grid from west to east.
///
/// A line is a car: steep where it is fast, flat where it waits. At each stop line a bar shows the light: the thicker,
/// the less it lets through.
pub fn space_time(recording: &Recording, row: usize, about: &About) -> Result<Svg> {
    let grid = recording.roads.grid;
    ensure!(row < grid.rows(), "a grid of {grid} has no row {row}");
    let agents: Vec<AgentId> = (0..grid.cols()).map(|col| AgentId(row * grid.cols() + col)).collect();
    let (west, east) = (Side::West.index(), Side::East.index());
    let mut lanes = Vec::new();
    for &agent in &agents {
        lanes.push(lane(&grid.incoming_edges(agent)[west]));
        lanes.push(grid.internal_lanes(agent)[west].clone());
    }
    lanes.push(lane(&grid.outgoing_edges(agents[agents.len() - 1])[east]));

    let mut begins_m = vec![0.0];
    let mut trajectories: BTreeMap<_, Vec<(f64, f64)>> = BTreeMap::new();
    for (number, name) in lanes.iter().enumerate() {
        for (step, cars) in recording.on_lane(name)?.enumerate() {
            for car in cars.iter() {
                trajectories.entry(car.id).or_default().push(((step + 1) as f64, begins_m[number] + car.position_m));
            }
        }
        begins_m.push(begins_m[number] + recording.roads.length_m(name)?);
    }
    let length_m = begins_m[lanes.len()];
    let seconds = recording.steps.len() as f64;

    let title = format!("Space and time: row {row} of a grid of {grid}, from west to east");
    let height = AROUND + EDGE_HEIGHT * (agents.len() as i32 + 1);
    picture((WIDTH, height), &title, &about.of_episode(), |area| {
        let (legend, area) = area.split_vertically(px(24));
        let mut chart = ChartBuilder::on(&area)
            .x_label_area_size(px(44))
            .y_label_area_size(px(58))
            .margin_right(px(48))
            .build_cartesian_2d(0.0..seconds, 0.0..length_m)?;
        // The insides of the intersections, so that the stop lines are seen where they are.
        for (col, &agent) in agents.iter().enumerate() {
            let (from, to) = (begins_m[2 * col + 1], begins_m[2 * col + 2]);
            chart.draw_series([Rectangle::new([(0.0, from), (seconds, to)], PALE.filled())])?;
            let place = chart.backend_coord(&(seconds, (from + to) / 2.0));
            let style = anchored(text(11, INK), HPos::Left, VPos::Center);
            let (x, y) = area.get_base_pixel();
            area.draw_text(&grid.light(agent), &style, (place.0 - x + px(8), place.1 - y))?;
        }
        draw_axes(&mut chart, "distance from the west end (m)", 8, true)?;
        for places in trajectories.into_values() {
            chart.draw_series(LineSeries::new(places, pen(INK, 1)))?;
        }
        let letter = Side::West.link_index();
        for (col, &agent) in agents.iter().enumerate() {
            let stop_line_m = begins_m[2 * col + 1];
            let mut from = 0;
            let shown = |step: usize| Shown::of(recording.steps[step].signals[agent.0].as_str().as_bytes()[letter]);
            let steps: Vec<Shown> = (0..recording.steps.len()).map(shown).collect();
            for phase in steps.chunk_by(|a, b| a == b) {
                let (height_m, colour) = phase[0].bar();
                let bar = [(from as f64, stop_line_m), ((from + phase.len()) as f64, stop_line_m + height_m)];
                chart.draw_series([Rectangle::new(bar, colour.filled())])?;
                from += phase.len();
            }
        }
        draw_legend(&legend)
    })
}

/// What a light shows to one approach.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shown {
    Green,
    Yellow,
    Red,
}

impl Shown {
    fn of(letter: u8) -> Shown {
        match letter {
            b'G' | b'g' => Shown::Green,
            b'y' | b'Y' => Shown::Yellow,
            _ => Shown::Red,
        }
    }

    /// Height in metres of the chart, and colour.
    fn bar(self) -> (f64, RGBColor) {
        match self {
            Shown::Green => (3.0, RGBColor(90, 190, 130)),
            Shown::Yellow => (7.0, RGBColor(240, 190, 40)),
            Shown::Red => (11.0, RGBColor(178, 24, 43)),
        }
    }
}

fn draw_legend(area: &Area<'_>) -> Result<()> {
    let style = anchored(text(11, INK), HPos::Left, VPos::Center);
    area.draw(&PathElement::new(vec![(px(58), px(10)), (px(84), px(10))], pen(INK, 1)))?;
    area.draw_text("a car", &style, (px(92), px(10)))?;
    let lights = [(Shown::Green, "green"), (Shown::Yellow, "yellow"), (Shown::Red, "red at the stop line")];
    for (number, (shown, word)) in lights.into_iter().enumerate() {
        let (height, colour) = shown.bar();
        let x = 158 + 100 * number as i32;
        area.draw(&Rectangle::new([(px(x), px(15 - height as i32)), (px(x + 26), px(15))], colour.filled()))?;
        area.draw_text(word, &style, (px(x + 34), px(10)))?;
    }
    Ok(())
}
