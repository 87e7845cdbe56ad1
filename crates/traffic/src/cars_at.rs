//! The cars on the approaches of one light.

use libsumo::{CarTable, LaneCars};

/// A part of a read of many lanes: those of one light, in the order of its approaches.
#[derive(Clone, Copy, Debug)]
pub struct CarsAt<'a> {
    table: &'a CarTable,
    first: usize,
    lanes: usize,
}

impl<'a> CarsAt<'a> {
    /// Takes the lanes `first..first + lanes` of a read.
    pub(crate) fn new(table: &'a CarTable, first: usize, lanes: usize) -> CarsAt<'a> {
        assert!(first + lanes <= table.lanes(), "lanes that were read");
        CarsAt { table, first, lanes }
    }

    /// Returns the number of lanes.
    pub(crate) fn lanes(&self) -> usize {
        self.lanes
    }

    /// Returns the cars on an approach.
    pub fn lane(&self, approach: usize) -> LaneCars<'a> {
        assert!(approach < self.lanes, "an approach of this light");
        self.table.lane(self.first + approach)
    }

    pub fn iter(&self) -> impl ExactSizeIterator<Item = LaneCars<'a>> + use<'a> {
        let CarsAt { table, first, lanes } = *self;
        (first..first + lanes).map(move |lane| table.lane(lane))
    }

    /// Returns the number of cars on all of its lanes.
    pub fn cars(&self) -> usize {
        self.iter().map(|lane| lane.len()).sum()
    }
}
