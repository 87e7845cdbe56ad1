//! Recordings as traces: the data for pictures of an episode.

use std::collections::BTreeMap;

use anyhow::Result;

use super::recording::Recording;
use crate::base::AgentId;
use crate::domain::road_trace::{Approach, Aspect, Corridor, CorridorLight, RoadTrace, Shown};
use crate::traffic::agents::phases::Light;
use crate::traffic::paper_grid::grid::lane;
use crate::traffic::side::Side;

/// Returns the trace, with a corridor from west to east for every row of the grid, the southernmost first.
pub fn trace(recording: &Recording) -> Result<RoadTrace> {
    let grid = recording.roads.grid;
    let agents = grid.agents();
    let light = |agent: &AgentId| recording.steps.iter().map(|step| shown(Light::of(&step.signals[agent.0]))).collect();
    Ok(RoadTrace {
        seconds: recording.steps.len(),
        rows: grid.rows(),
        columns: grid.cols(),
        names: agents.iter().map(|&agent| grid.light(agent)).collect(),
        greens: vec!["green for south and north", "green for west and east"],
        lights: agents.iter().map(light).collect(),
        approaches: (0..Side::ALL.len()).map(|side| approach(recording, side)).collect::<Result<_>>()?,
        corridors: (0..grid.rows()).map(|row| corridor(recording, row)).collect::<Result<_>>()?,
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
fn approach(recording: &Recording, side: usize) -> Result<Approach> {
    let grid = recording.roads.grid;
    let standing = |agent: AgentId| -> Result<Vec<usize>> {
        let edge = &grid.incoming_edges(agent)[side];
        Ok(recording.on_lane(&lane(edge))?.map(|cars| cars.halting()).collect())
    };
    let standing = grid.agents().into_iter().map(standing).collect::<Result<_>>()?;
    Ok(Approach { from: name(Side::ALL[side]), standing })
}

/// Returns the way through a row from west to east.
fn corridor(recording: &Recording, row: usize) -> Result<Corridor> {
    let grid = recording.roads.grid;
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
    let mut cars: BTreeMap<_, Vec<(f64, f64)>> = BTreeMap::new();
    for (number, name) in lanes.iter().enumerate() {
        for (step, on_lane) in recording.on_lane(name)?.enumerate() {
            for car in on_lane.iter() {
                cars.entry(car.id).or_default().push(((step + 1) as f64, begins_m[number] + car.position_m));
            }
        }
        begins_m.push(begins_m[number] + recording.roads.length_m(name)?);
    }
    let letter = Side::West.link_index();
    let crossing = |(col, &agent): (usize, &AgentId)| CorridorLight {
        name: grid.light(agent),
        begin_m: begins_m[2 * col + 1],
        end_m: begins_m[2 * col + 2],
        aspects: recording.steps.iter().map(|step| aspect(step.signals[agent.0].as_str().as_bytes()[letter])).collect(),
    };
    Ok(Corridor {
        name: format!("row {row} of a grid of {grid}"),
        from: name(Side::West),
        to: name(Side::East),
        length_m: begins_m[lanes.len()],
        crossings: agents.iter().enumerate().map(crossing).collect(),
        cars: cars.into_values().collect(),
    })
}

fn aspect(letter: u8) -> Aspect {
    match letter {
        b'G' | b'g' => Aspect::Green,
        b'y' | b'Y' => Aspect::Yellow,
        _ => Aspect::Red,
    }
}

fn name(side: Side) -> &'static str {
    match side {
        Side::West => "west",
        Side::South => "south",
        Side::East => "east",
        Side::North => "north",
    }
}
