//! Space and time: the cars of one corridor as lines, the lights they meet as bars.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};

use super::*;
use crate::base::AgentId;
use crate::traffic::grid::{Side, lane};
use crate::traffic::recording::Recording;

const WIDTH: u32 = 1100;
/// Pixels per edge of the corridor, and of what is around the chart.
const EDGE_HEIGHT: u32 = 105;
const AROUND: u32 = HEAD + 110;

/// The cars that drive through row `row` of the grid from west to east.
///
/// A line is a car: steep where it is fast, flat where it waits. At each stop line a bar shows the light: the thicker,
/// the less it lets through.
pub fn space_time(recording: &Recording, row: usize, about: &About) -> Result<String> {
    let grid = recording.roads.grid;
    ensure!(row < grid.rows(), "a grid of {grid} has no row {row}");
    let agents: Vec<AgentId> = (0..grid.cols()).map(|col| AgentId(row * grid.cols() + col)).collect();
    let west = Side::ALL.iter().position(|&side| side == Side::West).expect("all sides are there");
    let east = Side::ALL.iter().position(|&side| side == Side::East).expect("all sides are there");
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
    let height = AROUND + EDGE_HEIGHT * (agents.len() as u32 + 1);
    picture((WIDTH, height), &title, &about.of_episode(), |area| {
        let (legend, area) = area.split_vertically(24);
        let mut chart = ChartBuilder::on(&area)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .right_y_label_area_size(0)
            .margin_right(44)
            .build_cartesian_2d(0.0..seconds, 0.0..length_m)?;
        // The insides of the intersections, so that the stop lines are seen where they are.
        for (col, &agent) in agents.iter().enumerate() {
            let (from, to) = (begins_m[2 * col + 1], begins_m[2 * col + 2]);
            chart.draw_series([Rectangle::new([(0.0, from), (seconds, to)], PALE.filled())])?;
            let place = chart.backend_coord(&(seconds, (from + to) / 2.0));
            let style = anchored(type_of(13, INK), HPos::Left, VPos::Center);
            let (x, y) = area.get_base_pixel();
            area.draw_text(&grid.light(agent), &style, (place.0 - x + 8, place.1 - y))?;
        }
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc("time (s)")
            .y_desc("distance from the west end (m)")
            .axis_desc_style(type_of(14, INK))
            .label_style(type_of(13, INK))
            .axis_style(FAINT)
            .draw()?;
        for mut line in trajectories.into_values() {
            line.sort_by(|a, b| a.0.total_cmp(&b.0));
            chart.draw_series(LineSeries::new(line, INK.stroke_width(1)))?;
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
    let mut x = 58;
    let style = anchored(type_of(13, INK), HPos::Left, VPos::Center);
    area.draw(&PathElement::new(vec![(x, 10), (x + 26, 10)], INK.stroke_width(1)))?;
    area.draw_text("a car", &style, (x + 34, 10))?;
    x += 100;
    for (shown, word) in [(Shown::Green, "green"), (Shown::Yellow, "yellow"), (Shown::Red, "red at the stop line")] {
        let (height, colour) = shown.bar();
        area.draw(&Rectangle::new([(x, 15 - height as i32), (x + 26, 15)], colour.filled()))?;
        area.draw_text(word, &style, (x + 34, 10))?;
        x += 100;
    }
    Ok(())
}
