//! The cars on the lanes of one light.

use dials_core::domain::Result;
use libsumo::{CarTable, LaneCars, LaneId, Simulation};

/// A part of a read of many lanes: those of one light, in the order of its approaches.
#[derive(Clone, Copy, Debug)]
pub struct CarsAt<'a> {
    table: &'a CarTable,
    first: usize,
    lanes: usize,
}

impl<'a> CarsAt<'a> {
    pub(crate) fn new(table: &'a CarTable, first: usize, lanes: usize) -> CarsAt<'a> {
        assert!(first + lanes <= table.lanes(), "lanes that were read");
        CarsAt { table, first, lanes }
    }

    pub(crate) fn all(table: &'a CarTable) -> CarsAt<'a> {
        CarsAt::new(table, 0, table.lanes())
    }

    pub fn lane(&self, approach: usize) -> LaneCars<'a> {
        assert!(approach < self.lanes, "an approach of this light");
        self.table.lane(self.first + approach)
    }

    pub fn iter(&self) -> impl ExactSizeIterator<Item = LaneCars<'a>> + use<'a> {
        let CarsAt { table, first, lanes } = *self;
        (first..first + lanes).map(move |lane| table.lane(lane))
    }

    pub fn cars(&self) -> usize {
        self.iter().map(|lane| lane.len()).sum()
    }
}

/// Lanes of many lights, one row each, and the cars on them at the last read.
#[derive(Default)]
pub(crate) struct RowLanes {
    lanes: Vec<LaneId>,
    /// Number of the first lane of each row, and the number of all lanes.
    starts: Vec<usize>,
    pub(crate) cars: CarTable,
}

impl RowLanes {
    /// Takes the lanes of each row. Nobody is on them before the first read.
    pub(crate) fn new<'a>(rows: impl Iterator<Item = &'a [LaneId]>) -> RowLanes {
        let (mut lanes, mut starts) = (Vec::new(), vec![0]);
        for row in rows {
            lanes.extend_from_slice(row);
            starts.push(lanes.len());
        }
        RowLanes { cars: no_cars(lanes.len()), lanes, starts }
    }

    pub(crate) fn register<'a>(
        simulation: &mut Simulation,
        rows: impl Iterator<Item = Vec<&'a String>>,
    ) -> Result<RowLanes> {
        let rows = rows.map(|names| simulation.register_lanes(&names)).collect::<libsumo::Result<Vec<_>>>()?;
        Ok(RowLanes::new(rows.iter().map(Vec::as_slice)))
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.lanes.is_empty()
    }

    pub(crate) fn read(&mut self, simulation: &mut Simulation) -> Result<()> {
        Ok(simulation.read_lanes(&self.lanes, &mut self.cars)?)
    }

    /// Returns how much CO2 the cars on the lanes of each row emitted in the last step, in mg/s.
    pub(crate) fn co2_mg_per_s(&self, simulation: &mut Simulation) -> Result<Vec<f64>> {
        let mut of_lanes = Vec::new();
        simulation.co2_mg_per_s(&self.lanes, &mut of_lanes)?;
        Ok(self.starts.windows(2).map(|row| of_lanes[row[0]..row[1]].iter().sum()).collect())
    }

    pub(crate) fn at(&self, row: usize) -> CarsAt<'_> {
        self.of(&self.cars, row)
    }

    /// Returns the cars on the lanes of a row from an earlier read.
    pub(crate) fn of<'a>(&self, cars: &'a CarTable, row: usize) -> CarsAt<'a> {
        CarsAt::new(cars, self.starts[row], self.starts[row + 1] - self.starts[row])
    }
}

pub(crate) fn no_cars(lanes: usize) -> CarTable {
    CarTable::of(vec![Vec::new(); lanes])
}
