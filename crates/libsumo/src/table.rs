//! Cars by lane. Other crates ask for each lane in each second, and inline only what says so: there is no link-time optimisation.

use super::ids::CarId;

/// Speed below which a car stands in a queue (SUMO's own bound).
const HALTING_MPS: f64 = 0.1;

/// One car on a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Car {
    /// Its number.
    pub id: CarId,
    /// Distance in metres from the lane's beginning to the car's front bumper.
    pub position_m: f64,
    /// Speed in metres per second.
    pub speed_mps: f64,
}

impl Car {
    /// Returns whether it stands: slower than 0.1 m/s, SUMO's own bound.
    #[inline]
    pub fn stands(&self) -> bool {
        self.speed_mps < HALTING_MPS
    }
}

/// The cars on the lanes of one read, lane after lane in flat buffers that the next read reuses.
#[derive(Clone, Debug, PartialEq)]
pub struct CarTable {
    /// Bounds of the lanes: lane `i` of the read has the cars `starts[i]..starts[i + 1]`.
    starts: Vec<u32>,
    ids: Vec<CarId>,
    positions_m: Vec<f64>,
    speeds_mps: Vec<f64>,
}

impl CarTable {
    /// Makes a table without lanes, to be filled by [`Simulation::read_lanes`](crate::Simulation::read_lanes).
    pub fn new() -> Self {
        CarTable { starts: vec![0], ids: Vec::new(), positions_m: Vec::new(), speeds_mps: Vec::new() }
    }

    /// Makes a table of these lanes, each with its cars as (id, position in metres, speed in metres per second), the
    /// rearmost first.
    pub fn of(lanes: impl IntoIterator<Item = Vec<(CarId, f64, f64)>>) -> Self {
        let mut table = CarTable::new();
        for lane in lanes {
            for (id, position_m, speed_mps) in lane {
                table.ids.push(id);
                table.positions_m.push(position_m);
                table.speeds_mps.push(speed_mps);
            }
            table.starts.push(table.ids.len() as u32);
        }
        table
    }

    /// Returns the number of lanes read.
    #[inline]
    pub fn lanes(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns the number of cars on all of them.
    #[inline]
    pub fn cars(&self) -> usize {
        self.ids.len()
    }

    /// Returns the cars of the `lane`-th lane of the read, from 0.
    ///
    /// # Panics
    /// If the read had fewer lanes.
    #[inline]
    pub fn lane(&self, lane: usize) -> LaneCars<'_> {
        let cars = self.starts[lane] as usize..self.starts[lane + 1] as usize;
        LaneCars {
            ids: &self.ids[cars.clone()],
            positions_m: &self.positions_m[cars.clone()],
            speeds_mps: &self.speeds_mps[cars],
        }
    }

    /// Returns the lanes in the order of the read.
    #[inline]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = LaneCars<'_>> {
        (0..self.lanes()).map(|lane| self.lane(lane))
    }

    /// Copies one read into the table. `starts` begins with 0 and ends with the number of cars.
    pub(crate) fn fill(&mut self, starts: &[u32], ids: &[u64], positions_m: &[f64], speeds_mps: &[f64]) {
        self.starts.clear();
        self.starts.extend_from_slice(starts);
        self.ids.clear();
        self.ids.extend(ids.iter().map(|&id| CarId(id)));
        self.positions_m.clear();
        self.positions_m.extend_from_slice(positions_m);
        self.speeds_mps.clear();
        self.speeds_mps.extend_from_slice(speeds_mps);
    }
}

impl Default for CarTable {
    fn default() -> Self {
        CarTable::new()
    }
}

/// The cars of one lane, the rearmost first. The three slices have the same length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneCars<'a> {
    /// Numbers of the cars.
    pub ids: &'a [CarId],
    /// Distances in metres from the lane's beginning to the cars' front bumpers.
    pub positions_m: &'a [f64],
    /// Speeds in metres per second.
    pub speeds_mps: &'a [f64],
}

impl<'a> LaneCars<'a> {
    /// Returns the number of cars.
    #[inline]
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// Returns whether there is no car.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Returns the number of cars that stand: slower than 0.1 m/s, SUMO's own bound.
    #[inline]
    pub fn halting(&self) -> usize {
        self.standing().filter(|&(_, stands)| stands).count()
    }

    /// Returns the cars, each with whether it stands.
    #[inline]
    pub fn standing(&self) -> impl ExactSizeIterator<Item = (CarId, bool)> + use<'a> {
        self.iter().map(|car| (car.id, car.stands()))
    }

    /// Returns the cars, the rearmost first.
    #[inline]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Car> + use<'a> {
        let LaneCars { ids, positions_m, speeds_mps } = *self;
        let cars = ids.iter().zip(positions_m).zip(speeds_mps);
        cars.map(|((&id, &position_m), &speed_mps)| Car { id, position_m, speed_mps })
    }
}
