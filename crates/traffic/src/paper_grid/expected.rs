//! The expected content of a grid's files, as elements, to compare other files with. Pure.
//!
//! Routes and lights are read back from the text that [`content`] writes. The net is made by netconvert, so this module
//! states what netconvert 1.15 makes of our plain XML. `tests/traffic/networks` holds it against netconvert.

use super::content::{HALF_INTERSECTION_M, LANE_WIDTH_M, RADIUS_M, fixed_time, place};
use super::grid::{self, Grid, Node};
use crate::agents::region::{EDGE_M, SPEED_LIMIT_MPS};
use crate::network::tree::{Element, parse};
use crate::side::Side;
use dials_core::base::AgentId;

/// Returns the net of a grid, without what is only drawn (shapes of intersections, the place on the map).
pub(super) fn net(grid: Grid) -> Element {
    let mut net: String = grid.agents().into_iter().map(|agent| intersection(grid, agent)).collect();
    for (from, to) in grid.edges() {
        let id = grid::edge(from, to);
        let lane = lane(&id, EDGE_M, ends(grid, from, to));
        // The priority is netconvert's default.
        let attributes = format!(r#"from="{from}" to="{to}" priority="-1" length="{EDGE_M:.2}""#);
        net += &format!(r#"<edge id="{id}" {attributes}>{lane}</edge>"#);
        if matches!(to, Node::Boundary { .. }) {
            let (x, y) = place(grid, to);
            let attributes = format!(r#"type="dead_end" x="{x:.2}" y="{y:.2}" incLanes="{id}_0" intLanes="""#);
            net += &format!(r#"<junction id="{to}" {attributes}/>"#);
        }
    }
    read(&format!("<net>{net}</net>"))
}

/// Returns what this program writes, as elements.
pub(super) fn read(text: &str) -> Element {
    parse(text).expect("what this program writes is XML")
}

/// Returns an intersection with its light, and the ways through it, one per side that cars come from.
fn intersection(grid: Grid, agent: AgentId) -> String {
    let here = grid.intersection(agent);
    let (mut edges, mut requests, mut connections) = (String::new(), String::new(), String::new());
    let (mut incoming, mut inside) = (Vec::new(), Vec::new());
    for side in Side::LINK_ORDER {
        let [from, to] = [side, side.opposite()].map(|side| grid.neighbour(agent, side));
        let (onto, off, link) = (grid::edge(from, here), grid::edge(here, to), side.link_index());
        let id = format!(":{here}_{link}");
        // From the stop line of the incoming edge to the beginning of the outgoing edge.
        let lane = lane(&id, 2.0 * HALF_INTERSECTION_M, [ends(grid, from, here)[1], ends(grid, here, to)[0]]);
        edges += &format!(r#"<edge id="{id}" function="internal">{lane}</edge>"#);
        // If the light is out, east and west give way to north and south. Each way crosses the two of the other direction.
        let (state, response, foes) = if side.is_vertical() { ("O", "0000", "1010") } else { ("o", "0101", "0101") };
        requests += &format!(r#"<request index="{link}" response="{response}" foes="{foes}" cont="0"/>"#);
        // From the incoming edge onto the way through, and from there onto the outgoing edge.
        let rule = format!(r#"via="{id}_0" tl="{here}" linkIndex="{link}" dir="s" state="{state}""#);
        for (from, rule) in [(onto.as_str(), rule.as_str()), (&id, r#"dir="s" state="M""#)] {
            connections += &format!(r#"<connection from="{from}" to="{off}" fromLane="0" toLane="0" {rule}/>"#);
        }
        incoming.push(grid::lane(&onto));
        inside.push(grid::lane(&id));
    }
    let (x, y) = place(grid, here);
    let lanes = format!(r#"incLanes="{}" intLanes="{}""#, incoming.join(" "), inside.join(" "));
    let place = format!(r#"type="traffic_light" x="{x:.2}" y="{y:.2}" {lanes} radius="{RADIUS_M:.2}""#);
    let junction = format!(r#"<junction id="{here}" {place}>{requests}</junction>"#);
    edges + &fixed_time(&grid.light(agent)) + &junction + &connections
}

fn lane(edge: &str, length_m: f64, [(x0, y0), (x1, y1)]: [(f64, f64); 2]) -> String {
    let limits = format!(r#"speed="{SPEED_LIMIT_MPS:.2}" length="{length_m:.2}""#);
    format!(r#"<lane id="{edge}_0" index="0" {limits} shape="{x0:.2},{y0:.2} {x1:.2},{y1:.2}"/>"#)
}

/// Returns the stop lines where a lane begins and ends, half a lane to the right of the line between the nodes.
fn ends(grid: Grid, from: Node, to: Node) -> [(f64, f64); 2] {
    let ((x0, y0), (x1, y1)) = (place(grid, from), place(grid, to));
    let length = (x1 - x0).hypot(y1 - y0);
    let (dx, dy) = ((x1 - x0) / length, (y1 - y0) / length);
    [(x0, y0, inside(from)), (x1, y1, -inside(to))]
        .map(|(x, y, on)| (x + on * dx + LANE_WIDTH_M / 2.0 * dy, y + on * dy - LANE_WIDTH_M / 2.0 * dx))
}

fn inside(node: Node) -> f64 {
    if matches!(node, Node::Intersection { .. }) { HALF_INTERSECTION_M } else { 0.0 }
}
