//! How far two simulators agree on one light, or on several: on the cells of its approaches with cars, second by second,
//! and in sums over the seconds.

use std::ops::{AddAssign, Range};

use crate::agents::plan::AgentPlan;
use crate::agents::region::CELL_M;
use crate::cars_at::CarsAt;
use crate::observe::occupy;
use crate::sim::metrics::passed;
use libsumo::{CarId, CarTable};

/// How far before the stop lines cells are compared, in metres.
pub(crate) const COMPARED_M: f64 = 200.0;

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

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Comparison {
    pub cells: Agreement,
    pub sums: [Sums; 2],
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    pub seconds: u64,
    /// Seconds that cars were on the approaches, added up over the cars.
    pub car_seconds: u64,
    /// Speeds of these cars in these seconds, added up.
    pub speed_sum_mps: f64,
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

    pub fn passed_per_h(self) -> f64 {
        3600.0 * self.passed as f64 / self.seconds.max(1) as f64
    }

    pub fn backlog(self) -> f64 {
        self.waiting as f64 / self.seconds.max(1) as f64
    }

    pub fn waited_share(self) -> f64 {
        self.waited as f64 / self.came.max(1) as f64
    }

    pub fn dropped_share(self) -> f64 {
        self.dropped as f64 / self.came.max(1) as f64
    }
}

impl Comparison {
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

/// What a simulator shows of a light in a window of the episode.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    /// Whether there is a car in each cell, `[seconds][cells]`.
    pub(crate) cells: Vec<Vec<bool>>,
    pub(crate) sums: Sums,
    window: Range<usize>,
    of_approach: Vec<usize>,
    at_stop_line: Vec<bool>,
    second: usize,
    before: CarTable,
}

impl Seen {
    /// Begins an episode of a light, of which the seconds `window` are compared.
    pub(crate) fn new(plan: &AgentPlan, window: Range<usize>) -> Seen {
        let approaches = &plan.region.approaches;
        let cells = |length_m: f64, ahead_m: f64| (length_m.min(COMPARED_M - ahead_m).max(0.0) / CELL_M).ceil();
        Seen {
            cells: Vec::with_capacity(window.len()),
            sums: Sums::default(),
            window,
            of_approach: approaches.iter().map(|lane| cells(lane.length_m, lane.ahead_m) as usize).collect(),
            at_stop_line: approaches.iter().map(|lane| lane.ahead_m == 0.0).collect(),
            second: 0,
            before: CarTable::of(vec![Vec::new(); approaches.len()]),
        }
    }

    /// Notes the next second: cars on the approaches, those that left the road, and how many wait at the border.
    pub(crate) fn note(&mut self, plan: &AgentPlan, now: CarsAt<'_>, gone: &[CarId], waiting: usize) {
        if self.window.contains(&self.second) {
            let mut cells = vec![0.0; self.of_approach.iter().sum()];
            occupy(plan, now, &self.of_approach, &mut cells);
            self.cells.push(cells.into_iter().map(|bit| bit == 1.0).collect());
            let sums = &mut self.sums;
            sums.seconds += 1;
            sums.car_seconds += now.cars() as u64;
            sums.speed_sum_mps += now.iter().flat_map(|lane| lane.speeds_mps).sum::<f64>();
            sums.passed += passed(now, CarsAt::all(&self.before), gone, &self.at_stop_line);
            sums.waiting += waiting as u64;
        }
        let cars = now.iter().map(|lane| lane.iter().map(|car| (car.id, car.position_m, car.speed_mps)).collect());
        self.before = CarTable::of(cars);
        self.second += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::crossing;

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

    /// Notes one second after the other, with cars on the first approach as (number, position, speed).
    fn seen(plan: &AgentPlan, window: Range<usize>, seconds: &[&[(u64, f64, f64)]]) -> Seen {
        let mut seen = Seen::new(plan, window);
        for cars in seconds {
            let mut lanes = vec![Vec::new(); plan.region.approaches.len()];
            lanes[0] = cars.iter().map(|&(car, position_m, speed_mps)| (CarId(car), position_m, speed_mps)).collect();
            let table = CarTable::of(lanes);
            seen.note(plan, CarsAt::all(&table), &[], 2);
        }
        seen
    }

    #[test]
    fn only_the_window_counts_and_a_car_that_leaves_at_its_beginning_has_passed() {
        let plan = crossing();
        let seconds: [&[(u64, f64, f64)]; 4] =
            [&[(1, 98.0, 9.0)], &[(2, 62.0, 4.0), (3, 94.0, 6.0)], &[(2, 66.0, 4.0)], &[]];
        let found = seen(&plan, 1..3, &seconds);
        // Counted from the stop line: 38 m and 6 m, then 34 m.
        let cells = |second: usize| -> Vec<usize> {
            found.cells[second].iter().enumerate().filter(|(_, car)| **car).map(|(cell, _)| cell).collect()
        };
        assert_eq!((found.cells.len(), cells(0), cells(1)), (2, vec![0, 3], vec![3]));
        let sums = found.sums;
        assert_eq!((sums.seconds, sums.car_seconds, sums.speed_sum_mps, sums.waiting), (2, 3, 14.0, 4));
        assert_eq!(sums.passed, 2, "car 1 in the first second of the window, car 3 in the second one");
    }

    #[test]
    fn cells_are_compared_second_by_second() {
        let plan = crossing();
        let one = seen(&plan, 0..2, &[&[(1, 45.0, 0.0)], &[(1, 35.0, 0.0)]]);
        let other = seen(&plan, 0..2, &[&[(7, 41.0, 0.0), (8, 45.0, 0.0)], &[(7, 41.0, 0.0)]]);
        let cells = Comparison::of(&one, &other).cells;
        assert_eq!(cells, Agreement { first: 2, second: 2, both: 1 }, "two cars in a cell are one occupied cell");
    }
}
