//! How far two simulators agree on one light, or on several.

use std::ops::AddAssign;

use super::seen::Seen;

/// Cells with cars, counted in every second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Agreement {
    /// Cells with a car in the first simulator, in the second one, and in both.
    pub first: u64,
    pub second: u64,
    pub both: u64,
}

impl Agreement {
    /// Returns the share of the second simulator's cells that the first one has, too. Of no cell: 1.
    pub fn precision(self) -> f64 {
        share(self.both, self.second)
    }

    /// Returns the share of the first simulator's cells that the second one has, too. Of no cell: 1.
    pub fn recall(self) -> f64 {
        share(self.both, self.first)
    }

    /// Returns how many cells the second simulator has for one of the first. If both have none: 1.
    pub fn occupancy_ratio(self) -> f64 {
        if self.first == self.second { 1.0 } else { self.second as f64 / self.first.max(1) as f64 }
    }
}

fn share(part: u64, whole: u64) -> f64 {
    if whole == 0 { 1.0 } else { part as f64 / whole as f64 }
}

/// Two simulators of the same lights in the same seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Comparison {
    pub cells: Agreement,
    /// Sums of each of the two simulators.
    pub sums: [Sums; 2],
}

/// What a simulator shows in all seconds together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    pub seconds: u64,
    /// Seconds that cars were on the approaches, added up over the cars.
    pub car_seconds: u64,
    /// Speeds of these cars in these seconds, added up.
    pub speed_sum_mps: f64,
    /// Cars that crossed a stop line.
    pub passed: u64,
    /// Cars that came to the region from outside or departed on it, in all seconds of the episode; counted in an LS only.
    pub came: u64,
    /// How many of them found no room at first.
    pub waited: u64,
    /// How many of them found no room and were left out. Only an LS of a grid does that; in others they wait.
    pub dropped: u64,
    /// Cars that waited at the border, added up over the seconds.
    pub waiting: u64,
    /// Cars that could not be put where they were seen.
    pub lost: u64,
}

impl Sums {
    /// Returns the mean speed of the cars on the approaches in metres per second; 0 without cars.
    pub fn mean_speed_mps(self) -> f64 {
        self.speed_sum_mps / self.car_seconds.max(1) as f64
    }

    /// Returns the number of cars that cross the stop lines in an hour.
    pub fn passed_per_h(self) -> f64 {
        3600.0 * self.passed as f64 / self.seconds.max(1) as f64
    }

    /// Returns the mean number of cars that wait at the border.
    pub fn backlog(self) -> f64 {
        self.waiting as f64 / self.seconds.max(1) as f64
    }

    /// Returns the share of the cars that found no room at first.
    pub fn waited_share(self) -> f64 {
        self.waited as f64 / self.came.max(1) as f64
    }

    /// Returns the share of the cars that were left out, because there was no room.
    pub fn dropped_share(self) -> f64 {
        self.dropped as f64 / self.came.max(1) as f64
    }
}

impl Comparison {
    /// Compares what two simulators showed of a light, second by second.
    pub(crate) fn of(first: &Seen, second: &Seen) -> Comparison {
        assert_eq!(first.cells.len(), second.cells.len(), "the same seconds");
        let mut cells = Agreement::default();
        for (first, second) in first.cells.iter().zip(&second.cells) {
            for (&first, &second) in first.iter().zip(second) {
                cells.first += u64::from(first);
                cells.second += u64::from(second);
                cells.both += u64::from(first && second);
            }
        }
        Comparison { cells, sums: [first.sums, second.sums] }
    }
}

impl AddAssign for Comparison {
    /// Adds another light.
    fn add_assign(&mut self, other: Comparison) {
        self.cells.first += other.cells.first;
        self.cells.second += other.cells.second;
        self.cells.both += other.cells.both;
        for (sums, other) in self.sums.iter_mut().zip(other.sums) {
            sums.seconds = sums.seconds.max(other.seconds);
            sums.car_seconds += other.car_seconds;
            sums.speed_sum_mps += other.speed_sum_mps;
            sums.passed += other.passed;
            sums.came += other.came;
            sums.waited += other.waited;
            sums.dropped += other.dropped;
            sums.waiting += other.waiting;
            sums.lost += other.lost;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precision_is_of_the_second_simulator_and_recall_of_the_first() {
        let cells = Agreement { first: 8, second: 10, both: 6 };
        assert_eq!([cells.precision(), cells.recall(), cells.occupancy_ratio()], [0.6, 0.75, 1.25]);
        let nobody = Agreement::default();
        assert_eq!([nobody.precision(), nobody.recall(), nobody.occupancy_ratio()], [1.0; 3]);
        let ghosts = Agreement { first: 0, second: 3, both: 0 };
        assert_eq!([ghosts.precision(), ghosts.recall(), ghosts.occupancy_ratio()], [0.0, 1.0, 3.0]);
    }

    #[test]
    fn of_several_lights_cars_add_up_and_seconds_do_not() {
        let sums = Sums { seconds: 600, car_seconds: 100, speed_sum_mps: 500.0, passed: 30, ..Sums::default() };
        let waiting = Sums { came: 50, waited: 5, waiting: 60, ..sums };
        let one = Comparison { cells: Agreement { first: 4, second: 4, both: 1 }, sums: [sums, waiting] };
        let mut all = one;
        all += one;
        assert_eq!(all.cells, Agreement { first: 8, second: 8, both: 2 });
        let [gs, ls] = all.sums;
        // 60 cars in 600 s; 120 car-seconds of waiting in 600 s; 10 of 100 cars.
        assert_eq!([gs.mean_speed_mps(), gs.passed_per_h(), ls.backlog(), ls.waited_share()], [5.0, 360.0, 0.2, 0.1]);
    }
}
