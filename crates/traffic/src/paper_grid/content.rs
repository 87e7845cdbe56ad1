//! The content of the files of a network. Pure: returns text.
//!
//! The first four are *plain XML*, netconvert's input (nodes, edges, connections, lights). The others are SUMO's own.

use super::grid::{self, Grid, Node};
use super::inflow::Inflow;
use crate::agents::phases::Light;
use crate::agents::region::{EDGE_M, SPEED_LIMIT_MPS};
use crate::network::xml::{document, leaf, nest};
use crate::side::Side;

/// Corner radius of an intersection (the authors' setup).
pub(super) const RADIUS_M: f64 = 6.2;
/// SUMO's default width of a lane.
pub(super) const LANE_WIDTH_M: f64 = 3.2;
/// Distance from the centre of an intersection to its stop lines: one lane of the crossing road plus the radius. So a
/// lane inside an intersection is 18.8 m long, as in the authors' setup.
pub(super) const HALF_INTERSECTION_M: f64 = LANE_WIDTH_M + RADIUS_M;
/// Distance from a dead end to the centre of its intersection.
const REACH_M: f64 = EDGE_M + HALF_INTERSECTION_M;
const SPACING_M: f64 = EDGE_M + 2.0 * HALF_INTERSECTION_M;

/// The only vehicle type. IDM and its numbers: the authors' setup; IDM does not use sigma.
///
/// DEVIATION 1: speedDev is 0; the authors' cars draw a speed factor. Their desired speed is still exactly 10, because
/// SUMO raises the factor to fit departSpeed and maxSpeed caps it. Without the draw, a trajectory depends on arrivals
/// and lights alone.
const VEHICLE_TYPE: [(&str, &str); 11] = [
    ("id", "car"),
    ("carFollowModel", "IDM"),
    ("accel", "2.6"),
    ("decel", "7.5"),
    ("tau", "1.0"),
    ("minGap", "2.5"),
    ("length", "5"),
    ("maxSpeed", "10"),
    ("impatience", "0.5"),
    ("speedFactor", "1"),
    ("speedDev", "0"),
];

/// Deceleration above which braking is an emergency: the `decel` of the vehicle type.
pub(crate) const DECEL_MPS2: f64 = 7.5;

/// Seconds of each phase of the static program, in the order of [`Light::CYCLE`]. 10 s of green are our choice; any
/// value would do as long as nobody controls. 3 s of yellow are the authors'.
const STATIC_S: [&str; 4] = ["10", "3", "10", "3"];

/// Returns the intersections and the dead ends with their places. The south-west intersection is at (0, 0).
pub(super) fn nodes(grid: Grid) -> String {
    let node = |node: Node| {
        let (x, y) = place(grid, node);
        let kind = match node {
            Node::Intersection { .. } => format!(r#"type="traffic_light" radius="{RADIUS_M}""#),
            Node::Boundary { .. } => r#"type="dead_end""#.to_owned(),
        };
        format!(r#"<node id="{node}" x="{x:.1}" y="{y:.1}" {kind}/>"#)
    };
    format!("<nodes>{}</nodes>", grid.nodes().into_iter().map(node).collect::<String>())
}

pub(super) fn edges(grid: Grid) -> String {
    let edge = |(from, to)| {
        let id = grid::edge(from, to);
        let lanes = format!(r#"numLanes="1" speed="{SPEED_LIMIT_MPS}" length="{EDGE_M}""#);
        format!(r#"<edge id="{id}" from="{from}" to="{to}" {lanes}/>"#)
    };
    format!("<edges>{}</edges>", grid.edges().into_iter().map(edge).collect::<String>())
}

/// Returns the connections, straight on only (the authors' setup): no turns and no turnarounds.
pub(super) fn connections(grid: Grid) -> String {
    format!("<connections>{}</connections>", straight_on(grid, |_, _| String::new()))
}

/// Returns the programs that run when nobody controls the lights, and which letter rules which connection.
pub(super) fn lights(grid: Grid) -> String {
    let programs: String = grid.agents().into_iter().map(|agent| fixed_time(&grid.light(agent))).collect();
    let letters = straight_on(grid, |light, side| format!(r#" tl="{light}" linkIndex="{}""#, side.link_index()));
    format!("<tlLogics>{programs}{letters}</tlLogics>")
}

pub(super) fn fixed_time(light: &str) -> String {
    let phase = |(state, s): (Light, &str)| format!(r#"<phase duration="{s}" state="{}"/>"#, state.letters());
    let phases: String = Light::CYCLE.into_iter().zip(STATIC_S).map(phase).collect();
    format!(r#"<tlLogic id="{light}" type="static" programID="0" offset="0">{phases}</tlLogic>"#)
}

/// Returns one `<connection>` per way through an intersection, with the attributes that `more(light, side)` adds.
fn straight_on(grid: Grid, more: impl Fn(&str, Side) -> String) -> String {
    let mut connections = String::new();
    for agent in grid.agents() {
        let here = grid.intersection(agent);
        for side in Side::LINK_ORDER {
            let from = grid::edge(grid.neighbour(agent, side), here);
            let to = grid::edge(here, grid.neighbour(agent, side.opposite()));
            let more = more(&grid.light(agent), side);
            connections += &format!(r#"<connection from="{from}" to="{to}" fromLane="0" toLane="0"{more}/>"#);
        }
    }
    connections
}

/// Returns the vehicle type, the routes and, with `inflow`, one flow for each route on which cars arrive.
pub(super) fn routes(grid: Grid, inflow: Option<&Inflow>) -> String {
    let routes = grid.boundary_routes();
    document("routes", |xml| {
        leaf(xml, "vType", VEHICLE_TYPE)?;
        routes
            .iter()
            .try_for_each(|route| leaf(xml, "route", [("id", &route.id), ("edges", &route.edges.join(" "))]))?;
        let Some(inflow) = inflow else { return Ok(()) };
        routes.iter().try_for_each(|route| {
            let dead_end = route.from.to_string();
            let Some(probability) = inflow.at(&dead_end) else { return Ok(()) };
            let attributes = [
                ("id", dead_end), // A car is then called `w0.17`.
                ("type", "car".into()),
                ("route", route.id.clone()),
                ("begin", "0".into()),
                ("end", "86400".into()), // A day, so that sumo-gui plays on.
                ("probability", probability.to_string()),
                ("departLane", "free".into()), // The lane and the speed: the authors' setup.
                ("departSpeed", "10".into()),
            ];
            leaf(xml, "flow", attributes)
        })
    })
}

/// Returns SUMO's actuated controller, the paper's hand-coded baseline. Its numbers: the authors' setup.
///
/// SUMO 1.15 warns that no detector controls the yellow phases, and shows them for their least time, 3 s.
pub(super) fn actuated(grid: Grid) -> String {
    document("additional", |xml| {
        for agent in grid.agents() {
            let head = [("id", grid.light(agent)), ("type", "actuated".into()), ("programID", "actuated".into())];
            nest(xml, "tlLogic", head.into_iter().chain([("offset", "0".into())]), |xml| {
                leaf(xml, "param", [("key", "max-gap"), ("value", "3.0")])?;
                leaf(xml, "param", [("key", "detector-gap"), ("value", "0.8")])?;
                let times = [("8", "45"), ("3", "6"), ("8", "45"), ("3", "6")];
                Light::CYCLE.into_iter().zip(times).try_for_each(|(state, (min, max))| {
                    leaf(
                        xml,
                        "phase",
                        [("duration", min), ("minDur", min), ("maxDur", max), ("state", &state.letters())],
                    )
                })
            })?;
        }
        Ok(())
    })
}

/// Returns the distance in metres from the first intersection of a row or column to another one.
fn at(index: usize) -> f64 {
    SPACING_M * index as f64
}

/// Returns the metres east and north of the south-west intersection.
pub(super) fn place(grid: Grid, node: Node) -> (f64, f64) {
    match node {
        Node::Intersection { row, col } => (at(col), at(row)),
        Node::Boundary { side: Side::West, index } => (-REACH_M, at(index)),
        Node::Boundary { side: Side::South, index } => (at(index), -REACH_M),
        Node::Boundary { side: Side::East, index } => (at(grid.cols() - 1) + REACH_M, at(index)),
        Node::Boundary { side: Side::North, index } => (at(index), at(grid.rows() - 1) + REACH_M),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::YELLOW_STEPS;

    #[test]
    fn simulators_and_controllers_assume_the_vehicle_type_and_the_lights_that_are_written() {
        let of_the_type =
            |key: &str| VEHICLE_TYPE.iter().find(|(name, _)| *name == key).and_then(|(_, v)| v.parse().ok());
        assert_eq!(of_the_type("decel"), Some(DECEL_MPS2));
        assert_eq!(of_the_type("maxSpeed"), Some(SPEED_LIMIT_MPS));
        assert_eq!([STATIC_S[1], STATIC_S[3]].map(str::parse), [Ok(YELLOW_STEPS), Ok(YELLOW_STEPS)]);
    }
}
