//! Persons who wait at crossings with a signal.

use crate::agents::others_plan::Crossing;
use dials_core::domain::Result;
use libsumo::{EdgeId, Simulation};

/// Crossings of a loaded net.
pub(crate) struct Crossings {
    /// Pavements with the crossings to which they lead, in the order of the crossings.
    ways: Vec<[EdgeId; 2]>,
    /// Number of ways to each crossing.
    ways_of: Vec<usize>,
    on_ways: Vec<u32>,
}

impl Crossings {
    pub(crate) fn register<'a>(
        simulation: &mut Simulation,
        crossings: impl Iterator<Item = &'a Crossing> + Clone,
    ) -> Result<Crossings> {
        let ways = crossings.clone().flat_map(|Crossing { edge, areas }| areas.iter().map(move |area| [area, edge]));
        let ways: Vec<[&String; 2]> = ways.collect();
        let mut edges = |side: usize| simulation.register_edges(&ways.iter().map(|way| way[side]).collect::<Vec<_>>());
        let (areas, to) = (edges(0)?, edges(1)?);
        let ways = areas.into_iter().zip(to).map(|(area, crossing)| [area, crossing]).collect();
        Ok(Crossings { ways, ways_of: crossings.map(|crossing| crossing.areas.len()).collect(), on_ways: Vec::new() })
    }

    /// Returns how many persons stand at each crossing now.
    pub(crate) fn waiting(&mut self, simulation: &mut Simulation) -> Result<impl Iterator<Item = u32> + '_> {
        simulation.count_waiting(&self.ways, &mut self.on_ways)?;
        let mut rest = &self.on_ways[..];
        let persons = self.ways_of.iter().map(move |&ways| {
            let (own, others) = rest.split_at(ways);
            rest = others;
            own.iter().sum()
        });
        Ok(persons)
    }
}
