//! Recordings as traces: the data for pictures of an episode.
//!
//! - `of_grid`, `of_scenario`: the trace of either; [`route`]: the way along which a scenario is drawn.
//! - `drives`: the cars on lanes that follow each other.

mod drives;
mod of_grid;
mod of_scenario;
pub mod route;

use anyhow::Result;

use super::recorded_roads::{RecordedGround, RecordedRoads};
use super::recording::Recording;
use crate::side::Side;
use dials_core::domain::road_trace::{Aspect, RoadMap, RoadTrace};
use route::Route;

/// Returns the trace, with the ways along which cars can be drawn.
///
/// On a grid these are its rows from west to east, the southernmost first. On a scenario there is one: `route`, or the
/// route of a car on which lights meet the most cars. Without any car there is none.
pub fn trace(recording: &Recording, route: Option<&Route>) -> Result<RoadTrace> {
    match &recording.roads.ground {
        RecordedGround::Grid(grid) => of_grid::trace(recording, grid.grid),
        RecordedGround::Scenario(scenario) => of_scenario::trace(recording, scenario, route),
    }
}

/// Returns the map of a scenario. `None`: a grid, which needs none.
pub fn road_map(roads: &RecordedRoads) -> Option<RoadMap> {
    match &roads.ground {
        RecordedGround::Grid(_) => None,
        RecordedGround::Scenario(scenario) => Some(of_scenario::road_map(scenario)),
    }
}

fn aspect(letter: u8) -> Aspect {
    match letter {
        b'G' | b'g' | b'O' => Aspect::Green,
        b'y' | b'Y' | b'o' => Aspect::Yellow,
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
