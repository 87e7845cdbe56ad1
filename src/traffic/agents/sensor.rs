//! The sensor of one agent: the columns of its observation.

use std::ops::Range;

/// Which columns an observation has, in this order: cars, light, clock.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sensor {
    pub cars: CarColumns,
    pub light: LightColumns,
    /// Number of columns of the clock; 0 for none.
    pub clock: usize,
    /// Whether the d-set of the AIP (approximate influence predictor) also has a bit per approach: did a car enter?
    pub arrivals_in_d_set: bool,
}

/// How an observation shows the cars on the approaches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CarColumns {
    /// A bit for each cell of 10 m, from the lane's end on. One entry per approach: its number of visible cells.
    Cells(Vec<usize>),
    /// Two numbers from 0 to 1 for each approach: the share of it that a queue fills, and the share that cars fill.
    QueueAndDensity(usize),
}

/// How an observation shows the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightColumns {
    /// One-hot state of the paper's light with two greens: horizontal green, horizontal yellow, vertical yellow, vertical
    /// green.
    FourStates,
    /// One-hot green that is shown or comes next, a bit for the time between greens, and the steps since the green began
    /// or the last one ended, as a share of a minute, at most 1. The entry: number of greens.
    TargetAndAge(usize),
}

impl Sensor {
    /// Returns the number of columns.
    pub fn width(&self) -> usize {
        self.clock_columns().end
    }

    /// Returns the number of columns that show cars.
    pub fn car_columns(&self) -> usize {
        match &self.cars {
            CarColumns::Cells(cells) => cells.iter().sum(),
            CarColumns::QueueAndDensity(approaches) => 2 * approaches,
        }
    }

    /// Returns the columns of the clock, an empty range if there is none.
    pub fn clock_columns(&self) -> Range<usize> {
        let first = self.car_columns() + self.light.columns();
        first..first + self.clock
    }
}

impl LightColumns {
    /// Returns the number of columns.
    pub fn columns(self) -> usize {
        match self {
            LightColumns::FourStates => 4,
            LightColumns::TargetAndAge(greens) => greens + 2,
        }
    }
}
