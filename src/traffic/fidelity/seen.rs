//! What is compared of a light: the cells of its approaches with cars, second by second, and sums over the seconds.

use std::ops::Range;

use super::agreement::Sums;
use crate::sumo::CarTable;
use crate::traffic::agents::plan::AgentPlan;
use crate::traffic::agents::region::CELL_M;
use crate::traffic::cars_at::CarsAt;
use crate::traffic::observe::occupy;
use crate::traffic::sim::metrics::passed;

/// How far before the stop lines cells are compared, in metres.
pub const COMPARED_M: f64 = 200.0;

/// What a simulator shows of a light in a window of the episode.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Whether there is a car in each cell, `[seconds][cells]`.
    pub cells: Vec<Vec<bool>>,
    pub sums: Sums,
    window: Range<usize>,
    /// Number of cells of each approach.
    of_approach: Vec<usize>,
    at_stop_line: Vec<bool>,
    second: usize,
    before: CarTable,
}

impl Seen {
    /// Begins an episode of a light, of which the seconds `window` are compared.
    pub fn new(plan: &AgentPlan, window: Range<usize>) -> Seen {
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

    /// Notes the cars on the approaches after the next second, and the number of those that wait at the border.
    pub fn note(&mut self, plan: &AgentPlan, now: CarsAt<'_>, waiting: usize) {
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
            sums.passed += passed(now, CarsAt::new(&self.before, 0, now.lanes()), &self.at_stop_line);
            sums.waiting += waiting as u64;
        }
        let cars = now.iter().map(|lane| lane.iter().map(|car| (car.id, car.position_m, car.speed_mps)).collect());
        self.before = CarTable::of(cars);
        self.second += 1;
    }
}
