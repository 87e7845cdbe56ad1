//! The grid: its intersections, how they are joined, and all names.
//!
//! A grid of R x C *intersections*, each with a traffic light, whose roads end in dead-end *boundary* nodes. An agent
//! is an intersection; agents are numbered row-major from the south-west corner, as in the authors' setup. Names are
//! readable in sumo-gui: intersection `r0c1`, boundary `w0` (west end of row 0), edge `w0_r0c0` (from, to), its only
//! lane `w0_r0c0_0`. Arrays of four, one entry per side of an intersection, are in the order of `Side::ALL`.

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

pub(crate) fn edge(from: Node, to: Node) -> String {
    format!("{from}_{to}")
}

pub fn lane(edge: &str) -> String {
    format!("{edge}_0")
}

/// A route: the edges from one end of a row or column to the other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route {
    /// Name, such as `w0_to_e0`.
    pub id: String,
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

    pub fn incoming_edges(self, agent: AgentId) -> [String; 4] {
        Side::ALL.map(|side| edge(self.neighbour(agent, side), self.intersection(agent)))
    }

    pub fn outgoing_edges(self, agent: AgentId) -> [String; 4] {
        Side::ALL.map(|side| edge(self.intersection(agent), self.neighbour(agent, side)))
    }

    /// Returns the lanes inside the agent's intersection, by the side that their cars come from.
    pub fn internal_lanes(self, agent: AgentId) -> [String; 4] {
        // netconvert numbers the internal edges of an intersection like the links of its light.
        Side::ALL.map(|side| format!(":{}_{}_0", self.intersection(agent), side.link_index()))
    }

    pub fn light(self, agent: AgentId) -> String {
        self.intersection(agent).to_string()
    }

    /// Returns one route per boundary edge that leads in, straight through the grid: from west, south, east, north.
    pub fn boundary_routes(self) -> Vec<Route> {
        self.boundary().into_iter().map(|(side, index)| self.route(side, index)).collect()
    }

    /// Returns the intersections in the order of their agents, then the dead ends in the order of `boundary_routes`.
    pub fn nodes(self) -> Vec<Node> {
        let intersections = self.agents().into_iter().map(|agent| self.intersection(agent));
        let boundary = self.boundary().into_iter().map(|(side, index)| Node::Boundary { side, index });
        intersections.chain(boundary).collect()
    }

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

    pub(crate) fn place(self, agent: AgentId) -> (usize, usize) {
        assert!(agent.0 < self.rows * self.cols, "agent {agent} lives outside a grid of {self}");
        (agent.0 / self.cols, agent.0 % self.cols)
    }

    fn boundary(self) -> Vec<(Side, usize)> {
        let ends = |side: Side| if side.is_vertical() { self.cols } else { self.rows };
        Side::ALL.into_iter().flat_map(|side| (0..ends(side)).map(move |index| (side, index))).collect()
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
