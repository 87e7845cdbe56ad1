//! What is compared of a light: the cells of its approaches with cars, second by second, and sums over the seconds.

use std::ops::Range;

use super::agreement::Sums;
use crate::agents::plan::AgentPlan;
use crate::agents::region::CELL_M;
use crate::cars_at::CarsAt;
use crate::observe::occupy;
use crate::sim::metrics::passed;
use libsumo::{CarId, CarTable};

/// How far before the stop lines cells are compared, in metres.
pub(crate) const COMPARED_M: f64 = 200.0;

/// What a simulator shows of a light in a window of the episode.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    /// Whether there is a car in each cell, `[seconds][cells]`.
    pub(crate) cells: Vec<Vec<bool>>,
    pub(crate) sums: Sums,
    window: Range<usize>,
    /// Number of cells of each approach.
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

    /// Notes the cars on the approaches after the next second, those that left the road in it, and the number of those
    /// that wait at the border.
    pub(crate) fn note(&mut self, plan: &AgentPlan, now: CarsAt<'_>, gone: &[CarId], waiting: usize) {
        if self.window.contains(&self.second) {
            let mut cells = vec![0.0; self.of_approach.iter().sum()];
            let mut rest = &mut cells[..];
            for ((approach, lane), &count) in plan.region.approaches.iter().zip(now.iter()).zip(&self.of_approach) {
                occupy(approach, lane, rest.split_off_mut(..count).expect("as many cells as all approaches have"));
            }
            self.cells.push(cells.into_iter().map(|bit| bit == 1.0).collect());
            let sums = &mut self.sums;
            sums.seconds += 1;
            sums.car_seconds += now.cars() as u64;
            sums.speed_sum_mps += now.iter().flat_map(|lane| lane.speeds_mps).sum::<f64>();
            sums.passed += passed(now, CarsAt::new(&self.before, 0, now.lanes()), gone, &self.at_stop_line);
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
    use crate::agents::derive::overrides::Overrides;
    use crate::agents::derive::{Rules, derive};
    use crate::fidelity::agreement::{Agreement, Comparison};
    use crate::network::roads::example::{LIGHT_AT_U, roads};

    /// Returns the plan of the light J. Its first approach is 95 m long and ends at the stop line.
    fn plan() -> AgentPlan {
        let derived = derive(&roads(&LIGHT_AT_U), &Rules::default(), &Overrides::default()).unwrap();
        let mut agents = derived.agents.into_iter().map(|agent| agent.plan);
        agents.find(|plan| plan.light == "J").unwrap()
    }

    /// Notes one second after the other, with cars on the first approach as (number, position, speed).
    fn seen(plan: &AgentPlan, window: Range<usize>, seconds: &[&[(u64, f64, f64)]]) -> Seen {
        let mut seen = Seen::new(plan, window);
        for cars in seconds {
            let mut lanes = vec![Vec::new(); plan.region.approaches.len()];
            lanes[0] = cars.iter().map(|&(car, position_m, speed_mps)| (CarId(car), position_m, speed_mps)).collect();
            let table = CarTable::of(lanes);
            seen.note(plan, CarsAt::new(&table, 0, table.lanes()), &[], 2);
        }
        seen
    }

    #[test]
    fn only_the_window_counts_and_a_car_that_leaves_at_its_beginning_has_passed() {
        let plan = plan();
        assert_eq!((plan.region.approaches[0].length_m, plan.region.approaches[0].ahead_m), (95.0, 0.0));
        let seconds: [&[(u64, f64, f64)]; 4] =
            [&[(1, 93.0, 9.0)], &[(2, 57.0, 4.0), (3, 89.0, 6.0)], &[(2, 61.0, 4.0)], &[]];
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
        let plan = plan();
        let one = seen(&plan, 0..2, &[&[(1, 45.0, 0.0)], &[(1, 35.0, 0.0)]]);
        let other = seen(&plan, 0..2, &[&[(7, 41.0, 0.0), (8, 45.0, 0.0)], &[(7, 41.0, 0.0)]]);
        let cells = Comparison::of(&one, &other).cells;
        assert_eq!(cells, Agreement { first: 2, second: 2, both: 1 }, "two cars in a cell are one occupied cell");
    }
}
