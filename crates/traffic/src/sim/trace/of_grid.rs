//! The trace of an episode on a grid.

use anyhow::Result;

use super::drives::{Stretch, drives};
use super::{aspect, name};
use crate::agents::phases::Light;
use crate::paper_grid::grid::{Grid, lane};
use crate::side::Side;
use crate::sim::recording::Recording;
use dials_core::base::AgentId;
use dials_core::domain::road_trace::{Approach, Corridor, CorridorLight, Layout, RoadTrace, Shown};

/// Returns the trace, with a corridor from west to east for every row of the grid, the southernmost first.
pub fn trace(recording: &Recording, grid: Grid) -> Result<RoadTrace> {
    let agents = grid.agents();
    let light = |agent: &AgentId| recording.steps.iter().map(|step| shown(Light::of(&step.signals[agent.0]))).collect();
    Ok(RoadTrace {
        seconds: 0..recording.steps.len(),
        layout: Layout::Grid { rows: grid.rows(), columns: grid.cols() },
        names: agents.iter().map(|&agent| grid.light(agent)).collect(),
        greens: ["green for south and north", "green for west and east"].map(str::to_owned).to_vec(),
        lights: agents.iter().map(light).collect(),
        approaches: (0..Side::ALL.len()).map(|side| approach(recording, grid, side)).collect::<Result<_>>()?,
        corridors: (0..grid.rows()).map(|row| corridor(recording, grid, row)).collect::<Result<_>>()?,
    })
}

fn shown(light: Option<Light>) -> Shown {
    match light {
        Some(Light::VerticalGreen) => Shown::Green(0),
        Some(Light::HorizontalGreen) => Shown::Green(1),
        Some(Light::VerticalYellow | Light::HorizontalYellow) => Shown::Yellow,
        None => Shown::Other,
    }
}

/// Returns the approach from one side. `side`: an index into [`Side::ALL`].
fn approach(recording: &Recording, grid: Grid, side: usize) -> Result<Approach> {
    let standing = |agent: AgentId| -> Result<Vec<usize>> {
        let edge = &grid.incoming_edges(agent)[side];
        Ok(recording.on_lane(&lane(edge))?.map(|cars| cars.halting()).collect())
    };
    let standing = grid.agents().into_iter().map(standing).collect::<Result<_>>()?;
    Ok(Approach { from: name(Side::ALL[side]), standing })
}

/// Returns the way through a row from west to east.
fn corridor(recording: &Recording, grid: Grid, row: usize) -> Result<Corridor> {
    let agents: Vec<AgentId> = (0..grid.cols()).map(|col| AgentId(row * grid.cols() + col)).collect();
    let west = Side::ALL.iter().position(|&side| side == Side::West).expect("all sides are there");
    let east = Side::ALL.iter().position(|&side| side == Side::East).expect("all sides are there");
    // Per intersection: the lane that leads to it and the lane inside it. Then the lane that leads out.
    let mut lanes = Vec::new();
    for &agent in &agents {
        lanes.push(lane(&grid.incoming_edges(agent)[west]));
        lanes.push(grid.internal_lanes(agent)[west].clone());
    }
    lanes.push(lane(&grid.outgoing_edges(agents[agents.len() - 1])[east]));

    let mut begins_m = vec![0.0];
    for (number, name) in lanes.iter().enumerate() {
        begins_m.push(begins_m[number] + recording.roads.length_m(name)?);
    }
    let length_m = begins_m[lanes.len()];
    let stretch = |(lane, &begin_m): (String, &f64)| Stretch { lane, begin_m, scale: 1.0 };
    let stretches: Vec<Stretch> = lanes.into_iter().zip(&begins_m).map(stretch).collect();
    let letter = Side::West.link_index();
    let crossing = |(col, &agent): (usize, &AgentId)| CorridorLight {
        name: grid.light(agent),
        begin_m: begins_m[2 * col + 1],
        end_m: begins_m[2 * col + 2],
        aspects: recording.steps.iter().map(|step| aspect(step.signals[agent.0].as_str().as_bytes()[letter])).collect(),
    };
    Ok(Corridor {
        name: format!("row {row} of a grid of {grid}"),
        from: name(Side::West).to_owned(),
        to: name(Side::East).to_owned(),
        length_m,
        crossings: agents.iter().enumerate().map(crossing).collect(),
        cars: drives(recording, &stretches)?,
    })
}
