//! Persons who wait at crossings with a signal.

use std::collections::BTreeSet;

use crate::network::roads::{Function, Roads};
use dials_core::domain::Result;
use libsumo::{EdgeId, Simulation};

/// The crossings of a loaded net, and the pavements from which persons come to them.
pub(crate) struct Crossings {
    ways: Vec<[EdgeId; 2]>,
    waiting: Vec<u32>,
}

impl Crossings {
    pub(crate) fn register(simulation: &mut Simulation, roads: &Roads) -> Result<Crossings> {
        let is = |edge, function| roads.edge(edge).function == function;
        let edge_of = |lane| roads.lane(lane).edge;
        let signalled =
            roads.connections.iter().filter(|link| link.signal.is_some() && is(edge_of(link.to), Function::Crossing));
        let crossings: BTreeSet<_> = signalled.map(|link| edge_of(link.to)).collect();
        // Persons walk both ways: a crossing also leads to a pavement from which they come the other way.
        let from = roads.connections.iter().filter(|link| crossings.contains(&edge_of(link.to)));
        let to = roads.connections.iter().filter(|link| crossings.contains(&edge_of(link.from)));
        let ways = from.map(|link| [edge_of(link.from), edge_of(link.to)]);
        let ways = ways.chain(to.map(|link| [edge_of(link.to), edge_of(link.from)]));
        let ways: BTreeSet<_> = ways.filter(|[area, _]| is(*area, Function::WalkingArea)).collect();
        let names = |side: usize| ways.iter().map(|way| &*roads.edge(way[side]).id).collect::<Vec<_>>();
        let areas = simulation.register_edges(&names(0))?;
        let crossings = simulation.register_edges(&names(1))?;
        let ways = areas.into_iter().zip(crossings).map(|(area, crossing)| [area, crossing]).collect();
        Ok(Crossings { ways, waiting: Vec::new() })
    }

    /// Returns how many persons stand at crossings now.
    pub(crate) fn waiting(&mut self, simulation: &mut Simulation) -> Result<u64> {
        simulation.count_waiting(&self.ways, &mut self.waiting)?;
        Ok(self.waiting.iter().map(|&persons| u64::from(persons)).sum())
    }
}
