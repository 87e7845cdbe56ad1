//! The grid: its intersections, how they are joined, and all names.
//!
//! A grid of R x C *intersections*, each with a traffic light, whose roads end in dead-end *boundary* nodes. An agent
//! is an intersection; agents are numbered row-major from the south-west corner, as in the authors' setup. Names are
//! readable in sumo-gui: intersection `r0c1`, boundary `w0` (west end of row 0), edge `w0_r0c0` (from, to), its only
//! lane `w0_r0c0_0`. Arrays of four, one entry per side of an intersection, are in the order of `Side::ALL`.
//!
//! Pure: nothing here knows SUMO or a file. `make` writes a grid to files; `forest` copies the smallest one many times.

use std::fmt;

use anyhow::{Result, ensure};

use crate::side::Side;
use dials_core::base::AgentId;

/// A node where edges begin and end. `Display` writes its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Node {
    Intersection {
        row: usize,
        col: usize,
    },
    /// The dead end on one side of a row (west, east) or of a column (south, north).
    Boundary {
        side: Side,
        index: usize,
    },
}

impl fmt::Display for Node {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Node::Intersection { row, col } => write!(f, "r{row}c{col}"),
            Node::Boundary { side, index } => write!(f, "{}{index}", &side.name()[..1]),
        }
    }
}

/// Returns the name of the edge from one node to its neighbour.
pub(crate) fn edge(from: Node, to: Node) -> String {
    format!("{from}_{to}")
}

/// Returns the name of an edge's only lane.
pub fn lane(edge: &str) -> String {
    format!("{edge}_0")
}

/// A route: the edges from one end of a row or column to the other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route {
    /// Name, such as `w0_to_e0`.
    pub id: String,
    /// Dead end where the route begins.
    pub from: Node,
    pub(crate) edges: Vec<String>,
}

/// A grid of `rows` x `cols` intersections, at least one of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Grid {
    rows: usize,
    cols: usize,
}

impl Grid {
    /// The grid of one intersection: the shape of a local net.
    pub const SINGLE: Grid = Grid { rows: 1, cols: 1 };

    /// Largest number of intersections in a grid; the paper's largest has 100.
    pub(crate) const MOST: usize = 10_000;

    pub fn new(rows: usize, cols: usize) -> Result<Grid> {
        ensure!(rows >= 1 && cols >= 1, "a grid of {rows}x{cols}: needs at least one row and one column");
        ensure!(
            rows.checked_mul(cols).is_some_and(|intersections| intersections <= Grid::MOST),
            "a grid of {rows}x{cols}: must have at most {} intersections",
            Grid::MOST
        );
        Ok(Grid { rows, cols })
    }

    pub fn rows(self) -> usize {
        self.rows
    }

    pub fn cols(self) -> usize {
        self.cols
    }

    /// Returns the agents, one per intersection, row-major from the south-west corner.
    pub fn agents(self) -> Vec<AgentId> {
        AgentId::all(self.rows * self.cols)
    }

    /// Returns the intersection of an agent.
    pub(crate) fn intersection(self, agent: AgentId) -> Node {
        let (row, col) = self.place(agent);
        Node::Intersection { row, col }
    }

    /// Returns the node at the other end of the road that leaves the agent's intersection on `side`.
    pub(crate) fn neighbour(self, agent: AgentId, side: Side) -> Node {
        let (row, col) = self.place(agent);
        match side {
            Side::West if col > 0 => Node::Intersection { row, col: col - 1 },
            Side::South if row > 0 => Node::Intersection { row: row - 1, col },
            Side::East if col + 1 < self.cols => Node::Intersection { row, col: col + 1 },
            Side::North if row + 1 < self.rows => Node::Intersection { row: row + 1, col },
            Side::West | Side::East => Node::Boundary { side, index: row },
            Side::South | Side::North => Node::Boundary { side, index: col },
        }
    }

    /// Returns the edges that lead to the agent's intersection `[from west, from south, from east, from north]`.
    pub fn incoming_edges(self, agent: AgentId) -> [String; 4] {
        Side::ALL.map(|side| edge(self.neighbour(agent, side), self.intersection(agent)))
    }

    /// Returns the edges that leave the agent's intersection `[to west, to south, to east, to north]`.
    pub fn outgoing_edges(self, agent: AgentId) -> [String; 4] {
        Side::ALL.map(|side| edge(self.intersection(agent), self.neighbour(agent, side)))
    }

    /// Returns the lanes inside the agent's intersection, by the side that their cars come from. They belong to no edge
    /// of the grid: cars on them are neither observed nor rewarded.
    pub fn internal_lanes(self, agent: AgentId) -> [String; 4] {
        // netconvert numbers the internal edges of an intersection like the links of its light.
        Side::ALL.map(|side| format!(":{}_{}_0", self.intersection(agent), side.link_index()))
    }

    /// Returns the agent's traffic light, which has the name of its intersection.
    pub fn light(self, agent: AgentId) -> String {
        self.intersection(agent).to_string()
    }

    /// Returns one route per boundary edge that leads in, straight through the whole grid to the other side. The routes
    /// from the west come first, then those from the south, the east and the north.
    pub fn boundary_routes(self) -> Vec<Route> {
        self.boundary().into_iter().map(|(side, index)| self.route(side, index)).collect()
    }

    /// Returns the intersections in the order of their agents, then the dead ends in the order of `boundary_routes`.
    pub fn nodes(self) -> Vec<Node> {
        let intersections = self.agents().into_iter().map(|agent| self.intersection(agent));
        let boundary = self.boundary().into_iter().map(|(side, index)| Node::Boundary { side, index });
        intersections.chain(boundary).collect()
    }

    /// Returns every edge once, as (from, to).
    pub(crate) fn edges(self) -> Vec<(Node, Node)> {
        let mut edges = Vec::new();
        for agent in self.agents() {
            let here = self.intersection(agent);
            for side in Side::ALL {
                let there = self.neighbour(agent, side);
                edges.push((there, here));
                if matches!(there, Node::Boundary { .. }) {
                    edges.push((here, there)); // The edge to a neighbouring intersection is incoming there.
                }
            }
        }
        edges
    }

    /// Returns whether the road that leaves the agent's intersection on `side` leaves the grid.
    pub(crate) fn leaves(self, agent: AgentId, side: Side) -> bool {
        matches!(self.neighbour(agent, side), Node::Boundary { .. })
    }

    /// Returns the row and the column of an agent.
    pub(crate) fn place(self, agent: AgentId) -> (usize, usize) {
        assert!(agent.0 < self.rows * self.cols, "agent {agent} lives outside a grid of {self}");
        (agent.0 / self.cols, agent.0 % self.cols)
    }

    fn boundary(self) -> Vec<(Side, usize)> {
        Side::ALL.into_iter().flat_map(|side| (0..self.ends(side)).map(move |index| (side, index))).collect()
    }

    /// Returns the number of roads that end on one side of the grid.
    fn ends(self, side: Side) -> usize {
        match side {
            Side::West | Side::East => self.rows,
            Side::South | Side::North => self.cols,
        }
    }

    fn route(self, side: Side, index: usize) -> Route {
        let mut crossed: Vec<Node> = match side {
            Side::West | Side::East => (0..self.cols).map(|col| Node::Intersection { row: index, col }).collect(),
            Side::South | Side::North => (0..self.rows).map(|row| Node::Intersection { row, col: index }).collect(),
        };
        if matches!(side, Side::East | Side::North) {
            crossed.reverse();
        }
        let (from, to) = (Node::Boundary { side, index }, Node::Boundary { side: side.opposite(), index });
        let nodes: Vec<Node> = [from].into_iter().chain(crossed).chain([to]).collect();
        Route {
            id: format!("{from}_to_{to}"),
            from,
            edges: nodes.windows(2).map(|pair| edge(pair[0], pair[1])).collect(),
        }
    }
}

/// `2x3`: two rows, three columns.
impl fmt::Display for Grid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.rows, self.cols)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    fn grid(rows: usize, cols: usize) -> Grid {
        Grid::new(rows, cols).expect("a grid of the test")
    }

    #[test]
    fn agents_are_numbered_row_major_from_the_south_west_corner() {
        // north  r1c0 r1c1 r1c2   agents 3 4 5
        // south  r0c0 r0c1 r0c2   agents 0 1 2
        let names: Vec<String> = grid(2, 3).agents().into_iter().map(|agent| grid(2, 3).light(agent)).collect();
        assert_eq!(names, ["r0c0", "r0c1", "r0c2", "r1c0", "r1c1", "r1c2"]);
    }

    #[test]
    fn edges_come_in_the_order_west_south_east_north() {
        // The north-east corner of 2x2: neighbours to the west and south, dead ends to the east and north.
        let corner = AgentId(3);
        assert_eq!(grid(2, 2).incoming_edges(corner), ["r1c0_r1c1", "r0c1_r1c1", "e1_r1c1", "n1_r1c1"]);
        assert_eq!(grid(2, 2).outgoing_edges(corner), ["r1c1_r1c0", "r1c1_r0c1", "r1c1_e1", "r1c1_n1"]);
    }

    #[test]
    fn lanes_inside_an_intersection_are_numbered_like_the_letters_of_its_light() {
        assert_eq!(Grid::SINGLE.internal_lanes(AgentId(0)), [":r0c0_3_0", ":r0c0_2_0", ":r0c0_1_0", ":r0c0_0_0"]);
    }

    #[test]
    fn a_route_crosses_the_whole_grid() {
        let routes = grid(2, 3).boundary_routes();
        let ids: Vec<&str> = routes.iter().map(|route| route.id.as_str()).collect();
        let expected = ["w0_to_e0", "w1_to_e1", "s0_to_n0", "s1_to_n1", "s2_to_n2"];
        assert_eq!(ids[..5], expected);
        assert_eq!(ids[5..], ["e0_to_w0", "e1_to_w1", "n0_to_s0", "n1_to_s1", "n2_to_s2"]);
        assert_eq!(routes[1].edges, ["w1_r1c0", "r1c0_r1c1", "r1c1_r1c2", "r1c2_e1"]);
        assert_eq!(routes[9].edges, ["n2_r1c2", "r1c2_r0c2", "r0c2_s2"]);
    }

    #[test]
    fn the_routes_of_a_single_intersection_begin_on_its_incoming_edges_in_their_order() {
        let first: Vec<String> = Grid::SINGLE.boundary_routes().into_iter().map(|mut r| r.edges.remove(0)).collect();
        assert_eq!(first, Grid::SINGLE.incoming_edges(AgentId(0)));
    }

    #[test]
    fn every_edge_is_named_once() {
        // 4 incoming edges per intersection, and one out to each of the 2 (R + C) dead ends.
        let names: Vec<String> = grid(3, 2).edges().into_iter().map(|(from, to)| edge(from, to)).collect();
        assert_eq!(names.len(), 4 * 6 + 2 * (3 + 2));
        assert_eq!(names.iter().collect::<HashSet<_>>().len(), names.len());
        for agent in grid(3, 2).agents() {
            let around = [grid(3, 2).incoming_edges(agent), grid(3, 2).outgoing_edges(agent)].concat();
            assert!(around.iter().all(|edge| names.contains(edge)));
        }
    }

    #[test]
    fn a_grid_without_rows_is_refused() {
        let error = Grid::new(0, 3).unwrap_err().to_string();
        assert_eq!(error, "a grid of 0x3: needs at least one row and one column");
    }

    #[test]
    fn a_grid_that_no_machine_can_hold_is_refused() {
        for (rows, cols) in [(101, 100), (100_000, 100_000), (usize::MAX, 2)] {
            let error = Grid::new(rows, cols).unwrap_err().to_string();
            assert_eq!(error, format!("a grid of {rows}x{cols}: must have at most 10000 intersections"));
        }
        assert_eq!(grid(1, 10_000).agents().len(), 10_000);
    }

    #[test]
    #[should_panic(expected = "agent 4 lives outside a grid of 2x2")]
    fn an_agent_of_another_grid_is_a_mistake_of_the_caller() {
        grid(2, 2).light(AgentId(4));
    }
}
