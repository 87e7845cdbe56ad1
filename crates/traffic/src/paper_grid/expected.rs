//! The expected content of a grid's files, as elements, to compare other files with. Pure.
//!
//! Routes and lights are read back from the text that [`content`] writes. The net is made by netconvert, so this module
//! states what netconvert makes of our plain XML. A test checks that for grids of many shapes.

use super::content::{self, HALF_INTERSECTION_M, LANE_WIDTH_M, RADIUS_M, STATIC_S};
use super::grid::{self, Grid, Node};
use super::inflow::Inflow;
use crate::agents::phases::Light;
use crate::agents::region::{EDGE_M, SPEED_LIMIT_MPS};
use crate::network::tree::{Element, parse};
use crate::side::Side;
use dials_core::base::AgentId;

/// Returns the net of a grid, without what is only drawn (shapes of intersections, the place on the map). In the order
/// of netconvert's kinds: internal edges, edges, lights, junctions, connections.
pub(super) fn net(grid: Grid) -> Element {
    let agents = grid.agents();
    let mut all: Vec<Element> = agents.iter().flat_map(|&agent| internal_edges(grid, agent)).collect();
    all.extend(grid.edges().into_iter().map(|(from, to)| edge(grid, from, to)));
    all.extend(agents.iter().map(|&agent| light(grid, agent)));
    all.extend(agents.iter().map(|&agent| intersection(grid, agent)));
    all.extend(grid.edges().into_iter().filter_map(|(from, to)| dead_end(grid, from, to)));
    all.extend(agents.iter().flat_map(|&agent| connections(grid, agent)));
    element("net", [], all)
}

/// Returns the vehicle type, the routes and, if `inflow` is given, one flow per route.
pub(super) fn routes(grid: Grid, inflow: Option<f64>) -> Element {
    let inflow = inflow.map(Inflow::from);
    parse(&content::routes(grid, inflow.as_ref())).expect("what this program writes is XML")
}

/// Returns the actuated lights.
pub(super) fn actuated(grid: Grid) -> Element {
    parse(&content::actuated(grid)).expect("what this program writes is XML")
}

fn element<const N: usize>(name: &str, attributes: [(&str, String); N], children: Vec<Element>) -> Element {
    let attributes = attributes.map(|(key, value)| (key.to_owned(), value));
    Element { name: name.to_owned(), attributes: attributes.into(), children }
}

/// Returns the ways through an intersection, one per side that cars come from.
fn internal_edges(grid: Grid, agent: AgentId) -> [Element; 4] {
    let here = grid.intersection(agent);
    Side::LINK_ORDER.map(|side| {
        let (from, to) = (grid.neighbour(agent, side), grid.neighbour(agent, side.opposite()));
        // From the stop line of the incoming edge to the beginning of the outgoing edge.
        let shape = [ends(grid, from, here)[1], ends(grid, here, to)[0]];
        let id = internal_edge(here, side);
        let lane = lane(&id, 2.0 * HALF_INTERSECTION_M, shape);
        element("edge", [("id", id), ("function", "internal".into())], vec![lane])
    })
}

fn internal_edge(intersection: Node, from: Side) -> String {
    format!(":{intersection}_{}", from.link_index())
}

fn edge(grid: Grid, from: Node, to: Node) -> Element {
    let id = grid::edge(from, to);
    let lane = lane(&id, EDGE_M, ends(grid, from, to));
    let attributes = [
        ("id", id),
        ("from", from.to_string()),
        ("to", to.to_string()),
        ("priority", "-1".into()), // netconvert's default.
        ("length", metres(EDGE_M)),
    ];
    element("edge", attributes, vec![lane])
}

/// Returns the only lane of an edge.
fn lane(edge: &str, length_m: f64, shape: [(f64, f64); 2]) -> Element {
    let attributes = [
        ("id", grid::lane(edge)),
        ("index", "0".into()),
        ("speed", metres(SPEED_LIMIT_MPS)),
        ("length", metres(length_m)),
        ("shape", shape.map(|(x, y)| format!("{},{}", metres(x), metres(y))).join(" ")),
    ];
    element("lane", attributes, Vec::new())
}

/// Returns where the lane from one node to its neighbour begins and ends, from stop line to stop line. It is half a
/// lane to the right of the line between the nodes.
fn ends(grid: Grid, from: Node, to: Node) -> [(f64, f64); 2] {
    let ((x0, y0), (x1, y1)) = (content::place(grid, from), content::place(grid, to));
    let length = (x1 - x0).hypot(y1 - y0);
    let (dx, dy) = ((x1 - x0) / length, (y1 - y0) / length);
    [(x0, y0, inside(from)), (x1, y1, -inside(to))]
        .map(|(x, y, on)| (x + on * dx + LANE_WIDTH_M / 2.0 * dy, y + on * dy - LANE_WIDTH_M / 2.0 * dx))
}

/// Returns the metres from the centre of a node to its stop lines.
fn inside(node: Node) -> f64 {
    if matches!(node, Node::Intersection { .. }) { HALF_INTERSECTION_M } else { 0.0 }
}

fn light(grid: Grid, agent: AgentId) -> Element {
    let phases = Light::CYCLE.into_iter().zip(STATIC_S);
    let phases =
        phases.map(|(state, s)| element("phase", [("duration", s.into()), ("state", state.letters())], Vec::new()));
    let (kind, program) = (("type", "static".into()), ("programID", "0".into()));
    element("tlLogic", [("id", grid.light(agent)), kind, program, ("offset", "0".into())], phases.collect())
}

fn intersection(grid: Grid, agent: AgentId) -> Element {
    let here = grid.intersection(agent);
    let incoming = Side::LINK_ORDER.map(|side| grid::lane(&grid::edge(grid.neighbour(agent, side), here)));
    let inside = Side::LINK_ORDER.map(|side| grid::lane(&internal_edge(here, side)));
    // If the light is out, east and west give way to north and south. Each way crosses the two of the other direction.
    let requests = Side::LINK_ORDER.map(|side| {
        let (response, foes) = if has_priority(side) { ("0000", "1010") } else { ("0101", "0101") };
        let bits = [("response", response.into()), ("foes", foes.into()), ("cont", "0".into())];
        let [response, foes, cont] = bits;
        element("request", [("index", side.link_index().to_string()), response, foes, cont], Vec::new())
    });
    let (x, y) = content::place(grid, here);
    let attributes = [
        ("id", here.to_string()),
        ("type", "traffic_light".into()),
        ("x", metres(x)),
        ("y", metres(y)),
        ("incLanes", incoming.join(" ")),
        ("intLanes", inside.join(" ")),
        ("radius", metres(RADIUS_M)),
    ];
    element("junction", attributes, requests.into())
}

/// Returns whether netconvert gives the cars from a side priority.
fn has_priority(from: Side) -> bool {
    matches!(from, Side::North | Side::South)
}

/// Returns the dead end that an edge leads to, if it leads to one.
fn dead_end(grid: Grid, from: Node, to: Node) -> Option<Element> {
    let Node::Boundary { .. } = to else { return None };
    let (x, y) = content::place(grid, to);
    let attributes = [
        ("id", to.to_string()),
        ("type", "dead_end".into()),
        ("x", metres(x)),
        ("y", metres(y)),
        ("incLanes", grid::lane(&grid::edge(from, to))),
        ("intLanes", String::new()),
    ];
    Some(element("junction", attributes, Vec::new()))
}

/// Returns the connections straight on: from each incoming edge onto the way through, and from there onto the outgoing
/// edge.
fn connections(grid: Grid, agent: AgentId) -> Vec<Element> {
    let here = grid.intersection(agent);
    let both = Side::LINK_ORDER.map(|side| {
        let from = grid::edge(grid.neighbour(agent, side), here);
        let to = grid::edge(here, grid.neighbour(agent, side.opposite()));
        let inside = internal_edge(here, side);
        let onto = [
            ("from", from),
            ("to", to.clone()),
            ("fromLane", "0".into()),
            ("toLane", "0".into()),
            ("via", grid::lane(&inside)),
            ("tl", grid.light(agent)),
            ("linkIndex", side.link_index().to_string()),
            ("dir", "s".into()),
            ("state", if has_priority(side) { "O" } else { "o" }.into()),
        ];
        let off = [
            ("from", inside),
            ("to", to),
            ("fromLane", "0".into()),
            ("toLane", "0".into()),
            ("dir", "s".into()),
            ("state", "M".into()),
        ];
        [element("connection", onto, Vec::new()), element("connection", off, Vec::new())]
    });
    both.into_iter().flatten().collect()
}

/// Returns a length, coordinate or speed as netconvert writes it.
fn metres(value: f64) -> String {
    format!("{value:.2}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lane_lies_to_the_right_of_its_road_between_the_stop_lines() {
        let grid = Grid::new(1, 2).expect("a grid");
        let shape_of = |from, to| {
            let edge = edge(grid, from, to);
            edge.children[0].attribute("shape").expect("a lane has a shape").to_owned()
        };
        let [west, east] = [0, 1].map(|agent| grid.intersection(AgentId(agent)));
        // Centres at 0 and 118.8 m, stop lines 9.4 m from them; eastward the right is south, 1.6 m from the middle.
        assert_eq!(shape_of(west, east), "9.40,-1.60 109.40,-1.60");
        assert_eq!(shape_of(east, west), "109.40,1.60 9.40,1.60");
        let north = Node::Boundary { side: Side::North, index: 0 };
        assert_eq!(shape_of(north, west), "-1.60,109.40 -1.60,9.40");
    }
}
