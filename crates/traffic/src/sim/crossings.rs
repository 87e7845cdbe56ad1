//! Persons who wait at crossings with a signal.

use crate::agents::others_plan::Crossing;
use dials_core::base::Ragged;
use dials_core::domain::Result;
use libsumo::{EdgeId, Simulation};

/// Crossings of a loaded net, in rows: one per light.
pub(crate) struct Crossings {
    /// Pavements with the crossings to which they lead, in the order of the crossings.
    ways: Vec<[EdgeId; 2]>,
    /// Number of ways to each crossing.
    ways_of: Vec<usize>,
    on_ways: Vec<u32>,
    /// Persons who stood at each crossing when they were read last.
    waiting: Ragged<u32>,
}

impl Crossings {
    pub(crate) fn register<'a>(
        simulation: &mut Simulation,
        rows: impl Iterator<Item = &'a [Crossing]> + Clone,
    ) -> Result<Crossings> {
        let crossings = rows.clone().flatten();
        let ways = crossings.clone().flat_map(|crossing| crossing.areas.iter().map(move |area| [area, &crossing.edge]));
        let ways: Vec<[&String; 2]> = ways.collect();
        let mut edges = |side: usize| simulation.register_edges(&ways.iter().map(|way| way[side]).collect::<Vec<_>>());
        let (areas, to) = (edges(0)?, edges(1)?);
        Ok(Crossings {
            ways: areas.into_iter().zip(to).map(|(area, crossing)| [area, crossing]).collect(),
            ways_of: crossings.map(|crossing| crossing.areas.len()).collect(),
            on_ways: Vec::new(),
            waiting: Ragged::new(rows.map(<[Crossing]>::len)),
        })
    }

    /// Counts the persons who stand at each crossing now.
    pub(crate) fn read(&mut self, simulation: &mut Simulation) -> Result<()> {
        if self.ways.is_empty() {
            return Ok(());
        }
        simulation.count_waiting(&self.ways, &mut self.on_ways)?;
        let mut rest = &self.on_ways[..];
        for (persons, &ways) in self.waiting.as_mut_slice().iter_mut().zip(&self.ways_of) {
            let (own, others) = rest.split_at(ways);
            rest = others;
            *persons = own.iter().sum();
        }
        Ok(())
    }

    /// Returns the persons at each crossing of a row.
    pub(crate) fn at(&self, row: usize) -> &[u32] {
        self.waiting.row(row)
    }

    /// Returns the number of persons at all crossings.
    pub(crate) fn persons(&self) -> u64 {
        self.waiting.as_slice().iter().map(|&persons| u64::from(persons)).sum()
    }
}
