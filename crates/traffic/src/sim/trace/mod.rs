//! Recordings as traces: the data for pictures of an episode.

pub mod route;

use std::collections::BTreeMap;

use anyhow::Result;

use super::recorded_roads::{RecordedFiles, RecordedRoads};
use super::recording::Recording;
use crate::agents::plan::AgentPlan;
use crate::network::roads::{LaneNo, Roads};
use crate::paper_grid::grid::Grid;
use crate::scenario::kept::KEPT;
use crate::side::Side;
use dials_core::base::AgentId;
use dials_core::domain::road_trace::{Approach, Aspect, Corridor, CorridorLight, Layout, RoadMap, RoadTrace, Shown};
use libsumo::{CarId, SignalState};
use route::{Route, light_between, ways};

/// Returns the trace, with the ways along which cars can be drawn.
///
/// On a grid these are its rows from west to east, the southernmost first. On a scenario there is one: `route`, or the
/// route of a car on which lights meet the most cars. Without any car there is none.
pub fn trace(recording: &Recording, route: Option<&Route>) -> Result<RoadTrace> {
    let RecordedRoads { agents, roads, .. } = &*recording.roads;
    let most = agents.iter().map(|agent| agent.phases.greens().len()).max().unwrap_or(0);
    let light = |(row, agent): (usize, &AgentPlan)| {
        recording.steps.iter().map(|step| shown(agent, &step.signals[row])).collect()
    };
    let (layout, greens, corridors) = match recording.roads.grid() {
        Some(grid) => (
            Layout::Grid { rows: grid.rows(), columns: grid.cols() },
            ["green for south and north", "green for west and east"].map(str::to_owned).to_vec(),
            (0..grid.rows()).map(|row| of_row(recording, grid, row)).collect::<Result<_>>()?,
        ),
        None => {
            let route = route.cloned().or_else(|| Route::busiest(recording));
            (
                Layout::Map(map(&recording.roads)),
                (0..most).map(|green| format!("green {green}")).collect(),
                route.iter().map(|route| corridor(recording, roads, route)).collect::<Result<_>>()?,
            )
        }
    };
    Ok(RoadTrace {
        seconds: 0..recording.steps.len(),
        layout,
        names: agents.iter().map(|agent| agent.light.clone()).collect(),
        greens,
        lights: agents.iter().enumerate().map(light).collect(),
        approaches: approaches(recording)?,
        corridors,
    })
}

pub(crate) fn map(recorded: &RecordedRoads) -> RoadMap {
    let RecordedRoads { agents, roads, files, .. } = recorded;
    RoadMap {
        place: place_of(files),
        junctions: roads.outlines(),
        lanes: roads.lanes_of_cars().map(|lane| roads.lane(lane).shape.clone()).collect(),
        lights_m: agents.iter().map(|agent| agent.place_m).collect(),
    }
}

/// Returns the place in words. The copy in a run directory has lost the name that its user knows.
fn place_of(files: &RecordedFiles) -> String {
    match files {
        RecordedFiles::Grid(files) => format!("a grid of {}", files.grid),
        RecordedFiles::Local(files) => format!("the local simulator of light {}", files.net.light),
        RecordedFiles::Whole(files) => match files.path().file_stem().unwrap_or_default().to_string_lossy().as_ref() {
            KEPT => "a scenario".to_owned(),
            name => format!("scenario {name}"),
        },
    }
}

fn shown(agent: &AgentPlan, state: &SignalState) -> Shown {
    match agent.phases.green_of(state) {
        Some(green) => Shown::Green(green),
        None if state.as_str().contains(['y', 'Y']) => Shown::Yellow,
        None => Shown::Other,
    }
}

/// Returns the queues by the quarter of the compass that cars come from. Each has the lights with such approaches.
fn approaches(recording: &Recording) -> Result<Vec<Approach>> {
    let RecordedRoads { agents, roads, .. } = &*recording.roads;
    let mut approaches = Vec::new();
    for side in Side::ALL {
        let mut standing = Vec::new();
        for agent in agents {
            let lanes = agent.region.approaches.iter().map(|approach| approach.lane.as_str());
            let mut lanes = lanes.filter(|lane| comes_from(roads, lane) == side).peekable();
            if lanes.peek().is_none() {
                continue;
            }
            let mut queue = vec![0; recording.steps.len()];
            for lane in lanes {
                queue.iter_mut().zip(recording.on_lane(lane)?).for_each(|(queue, cars)| *queue += cars.halting());
            }
            standing.push(queue);
        }
        if !standing.is_empty() {
            approaches.push(Approach { from: side.name(), standing });
        }
    }
    Ok(approaches)
}

/// Returns the side from which cars come on a lane, by its direction at its end.
fn comes_from(roads: &Roads, lane: &str) -> Side {
    let shape = roads.lane_named(lane).map_or(&[][..], |lane| &roads.lane(lane).shape);
    let piece = shape.windows(2).rev().find(|piece| piece[0] != piece[1]);
    let [east, north] = piece.map_or([1.0, 0.0], |piece| [0, 1].map(|axis| piece[1][axis] - piece[0][axis]));
    match (east.abs() >= north.abs(), east > 0.0, north > 0.0) {
        (true, true, _) => Side::West,
        (true, false, _) => Side::East,
        (false, _, true) => Side::South,
        (false, _, false) => Side::North,
    }
}

fn of_row(recording: &Recording, grid: Grid, row: usize) -> Result<Corridor> {
    let mut agents = (0..grid.cols()).map(|col| AgentId(row * grid.cols() + col));
    let mut edges: Vec<String> =
        agents.clone().map(|agent| grid.incoming_edges(agent)[Side::West.index()].clone()).collect();
    edges.extend(agents.next_back().map(|agent| grid.outgoing_edges(agent)[Side::East.index()].clone()));
    let roads = &recording.roads.roads;
    let (from, to) = (Side::West.name().to_owned(), Side::East.name().to_owned());
    let name = format!("row {row} of a grid of {grid}");
    Ok(Corridor { name, from, to, ..corridor(recording, roads, &Route::read(&edges.join(","), roads)?)? })
}

fn corridor(recording: &Recording, roads: &Roads, route: &Route) -> Result<Corridor> {
    let edges = &route.0;
    let mut stretches = Vec::new();
    let mut crossings = Vec::new();
    let mut begin_m = 0.0;
    for (number, &edge) in edges.iter().enumerate() {
        let lanes = &roads.edge(edge).lanes;
        let length_m = lanes.iter().map(|&lane| roads.lane(lane).length_m).fold(0.0, f64::max);
        for &lane in lanes {
            stretches.push((lane, begin_m, length_m / roads.lane(lane).length_m));
        }
        begin_m += length_m;
        let Some(&next) = edges.get(number + 1) else { break };
        // Ways from lane to lane within a junction differ in length. The longest one sets the scale.
        let within_m = ways(roads, edge, next).map(|way| roads.length_within_junction(way)).fold(0.0, f64::max);
        for way in ways(roads, edge, next) {
            let scale = within_m / roads.length_within_junction(way);
            let mut piece_m = begin_m;
            for lane in roads.lanes_within_junction(way) {
                stretches.push((lane, piece_m, scale));
                piece_m += roads.lane(lane).length_m * scale;
            }
        }
        if let Some(light) = light_between(roads, edge, next) {
            let signals = ways(roads, edge, next).filter_map(|way| way.signal.as_ref());
            let letters: Vec<usize> = signals.map(|signal| signal.letter).collect();
            let aspects = aspects(recording, light, &letters);
            crossings.push(CorridorLight { name: light.to_owned(), begin_m, end_m: begin_m + within_m, aspects });
        }
        begin_m += within_m;
    }
    let [from, to] = [edges[0], edges[edges.len() - 1]].map(|edge| roads.edge(edge).name().to_owned());
    let name = if edges.len() == 1 { "one edge".to_owned() } else { format!("a route of {} edges", edges.len()) };
    let cars = trajectories(recording, &stretches)?;
    Ok(Corridor { name, from, to, length_m: begin_m, crossings, cars })
}

/// A lane on a way: metres from the beginning of the way to that of the lane, and metres on the way for a metre on the
/// lane, because lanes side by side may differ in length.
type Stretch = (LaneNo, f64, f64);

/// Returns the trajectories: seconds and metres on the way. A car that leaves the way and comes back has two.
fn trajectories(recording: &Recording, stretches: &[Stretch]) -> Result<Vec<Vec<(f64, f64)>>> {
    let mut cars: BTreeMap<CarId, Vec<(usize, f64)>> = BTreeMap::new();
    for &(lane, begin_m, scale) in stretches {
        let name = &recording.roads.roads.lane(lane).id;
        for (step, on_lane) in recording.on_lane(name)?.enumerate() {
            for car in on_lane.iter() {
                cars.entry(car.id).or_default().push((step + 1, begin_m + car.position_m * scale));
            }
        }
    }
    let mut trajectories = Vec::new();
    for mut points in cars.into_values() {
        points.sort_by_key(|&(second, _)| second);
        let goes_on = |one: &(usize, f64), next: &(usize, f64)| next.0 == one.0 + 1 && next.1 >= one.1;
        let parts = points.chunk_by(goes_on);
        trajectories.extend(parts.map(|part| part.iter().map(|&(second, place_m)| (second as f64, place_m)).collect()));
    }
    Ok(trajectories)
}

/// Returns what a light shows to ways with these letters: green if any of them has green.
fn aspects(recording: &Recording, light: &str, letters: &[usize]) -> Vec<Aspect> {
    let number = recording.roads.lights.iter().position(|other| other == light);
    let number = number.expect("all lights that control a way are recorded");
    let shown = recording.steps.iter().map(|step| {
        let state = step.signals[number].as_str().as_bytes();
        let shows = |wanted: &[u8]| letters.iter().any(|&letter| wanted.contains(&state[letter]));
        if shows(b"GgO") {
            Aspect::Green
        } else if shows(b"yYo") {
            Aspect::Yellow
        } else {
            Aspect::Red
        }
    });
    shown.collect()
}
