//! The net that local nets are cut out of.

use crate::network::roads::{EdgeNo, Roads};
use crate::network::tree::Element;

/// A whole net, as text and as roads.
pub(crate) struct Source<'a> {
    pub(crate) net: &'a Element,
    /// Roads of this net.
    pub(crate) roads: &'a Roads,
    /// Programs of lights in other files, which SUMO loads after the net.
    pub(crate) programs: Vec<&'a Element>,
    /// Elements by their numbers in `roads`.
    pub(super) junctions: Vec<&'a Element>,
    pub(super) edges: Vec<&'a Element>,
    pub(super) connections: Vec<&'a Element>,
}

impl<'a> Source<'a> {
    /// `net`: the root element that `roads` was read from.
    pub(crate) fn new(net: &'a Element, roads: &'a Roads, programs: Vec<&'a Element>) -> Source<'a> {
        let [junctions, edges, connections] =
            ["junction", "edge", "connection"].map(|kind| net.all(kind).collect::<Vec<_>>());
        let counts = [roads.junctions.len(), roads.edges.len(), roads.connections.len()];
        assert_eq!([junctions.len(), edges.len(), connections.len()], counts, "the roads of this net");
        Source { net, roads, programs, junctions, edges, connections }
    }

    /// Returns the junction at which a road ends.
    pub(super) fn end(&self, road: EdgeNo) -> &'a Element {
        let [_, end] = self.roads.edge(road).ends.expect("a road has two ends");
        self.junctions[end.0]
    }
}
