//! What the detectors of a light have seen, for agents that see nothing else of the cars.
//!
//! It is computed from the cars' places at the end of every second, alike in the GS and in local simulators. A car comes
//! to a detector in a second if its front is behind the beginning now, and was before it a second ago. A car that crosses
//! the stop line in the same second is no longer on the lane. It counts, too.

use rand::Rng;

use crate::agents::loops::Loop;
use crate::agents::region_plan::RegionPlan;
use crate::cars_at::CarsAt;
use crate::config::DetectorFaults;
use crate::events::site::DetectorPlace;
use dials_core::base::{Dice, Seed};
use libsumo::CarId;

/// Number of columns of a detector: count, occupancy and gap.
pub(crate) const COLUMNS: usize = 3;

/// Seconds after which a gap no longer grows.
const LONGEST_GAP_S: u32 = 60;

/// Cars in a second when a queue leaves: one every two seconds. A count is a share of that.
const SATURATION_PER_S: f32 = 0.5;

/// Seconds without a car at the stop line after which nobody is between it and the advance detector: whoever crossed that one has come
/// or has changed lanes.
const NOBODY_S: u32 = 8;

/// Largest speed gained in a second, in metres per second.
const GAIN_MPS: f64 = 3.0;

/// Purpose of the stream from which faults are drawn.
const FAULTS: &str = "detector faults";

/// The detectors of one light in an episode.
#[derive(Clone, Debug)]
pub(crate) struct Readings {
    loops: Vec<Loop>,
    now: Vec<Reading>,
    dead: Vec<bool>,
    faults: DetectorFaults,
    dice: Dice,
    /// Seconds since the last decision.
    seconds: u32,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Reading {
    /// Cars that came since the last decision.
    counted: u32,
    /// Seconds since the last decision in which a car was over it.
    on_s: u32,
    /// Seconds since a car was over it.
    gap_s: u32,
    /// Cars that have crossed it, and not yet the detector at the stop line. Only for advance detectors.
    between: u32,
    /// Cars before it that may cross it and the stop line within a second.
    near: Vec<CarId>,
}

impl Readings {
    /// Begins an episode on empty roads. `episode`: the stream of the light in this episode.
    pub(crate) fn begin(loops: &[Loop], faults: DetectorFaults, episode: Seed) -> Readings {
        let count = loops.len();
        let mut dice = episode.fork_named(FAULTS).dice();
        let dead = (0..count).map(|_| dice.random_bool(faults.dead)).collect();
        let empty = Reading { gap_s: LONGEST_GAP_S, ..Reading::default() };
        Readings { loops: loops.to_vec(), now: vec![empty; count], dead, faults, dice, seconds: 0 }
    }

    /// Returns the number of detectors.
    pub(crate) fn len(&self) -> usize {
        self.now.len()
    }

    pub(crate) fn decide(&mut self) {
        self.seconds = 0;
        for reading in &mut self.now {
            (reading.counted, reading.on_s) = (0, 0);
        }
    }

    /// Notes the cars on the approaches at the end of a second.
    pub(crate) fn second(&mut self, region: &RegionPlan, cars: CarsAt<'_>) {
        self.seconds += 1;
        let mut counts = Vec::with_capacity(self.loops.len());
        for ((reading, detector), &dead) in self.now.iter_mut().zip(&self.loops).zip(&self.dead) {
            let lane = cars.lane(detector.approach);
            let is_here = |car: &CarId| cars.iter().any(|lane| lane.ids.contains(car));
            let left = reading.near.iter().filter(|car| !is_here(car)).count();
            let came = |position_m: f64, speed_mps: f64| {
                position_m >= detector.begin_m && position_m - speed_mps < detector.begin_m
            };
            let mut counted = lane.iter().filter(|car| came(car.position_m, car.speed_mps)).count() + left;
            let is_over = |position_m: &f64| (detector.begin_m..detector.end_m).contains(position_m);
            let mut is_on = counted > 0 || lane.positions_m.iter().any(is_over);
            let length_m = region.approaches[detector.approach].length_m;
            reading.near.clear();
            let may_leave = lane.iter().filter(|car| {
                car.position_m < detector.begin_m && car.position_m + car.speed_mps + GAIN_MPS >= length_m
            });
            reading.near.extend(may_leave.map(|car| car.id));
            if self.faults.noise > 0.0 && self.dice.random_bool(self.faults.noise) {
                (counted, is_on) = if is_on { (0, false) } else { (1, true) };
            }
            if dead {
                (counted, is_on) = (0, false);
            }
            reading.counted += counted as u32;
            reading.on_s += u32::from(is_on);
            reading.gap_s = if is_on { 0 } else { (reading.gap_s + 1).min(LONGEST_GAP_S) };
            counts.push(counted as u32);
        }
        for (number, detector) in self.loops.iter().enumerate() {
            if detector.place == DetectorPlace::Advance {
                // The one at the stop line is right before it.
                let (at_stop_bar, left) = (self.now[number - 1].gap_s, counts[number - 1]);
                let reading = &mut self.now[number];
                let nobody = at_stop_bar.min(reading.gap_s) >= NOBODY_S;
                reading.between = if nobody { 0 } else { (reading.between + counts[number]).saturating_sub(left) };
            }
        }
    }

    /// Writes count, occupancy and gap of each detector: numbers from 0 to 1.
    pub(crate) fn write(&self, columns: &mut [f32]) {
        self.iter()
            .zip(columns.chunks_exact_mut(COLUMNS))
            .for_each(|((_, read, _), columns)| columns.copy_from_slice(&read));
    }

    /// Returns each detector with what [`Readings::write`] writes of it, and for an advance detector the number of cars between it and
    /// the one at the stop line, as far as both have counted.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&Loop, [f32; COLUMNS], u32)> {
        let seconds = self.seconds.max(1) as f32;
        let read = move |reading: &Reading| {
            let count = (reading.counted as f32 / (SATURATION_PER_S * seconds)).min(1.0);
            [count, reading.on_s as f32 / seconds, reading.gap_s as f32 / LONGEST_GAP_S as f32]
        };
        self.loops.iter().zip(&self.now).map(move |(detector, reading)| (detector, read(reading), reading.between))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Observation, TrafficConfig};
    use crate::paper_grid::grid::Grid;
    use crate::paper_grid::plans::plans;
    use libsumo::CarTable;

    fn plan() -> crate::agents::plan::AgentPlan {
        let config = TrafficConfig { observation: Observation::Detectors, ..TrafficConfig::new("", "") };
        plans(Grid::SINGLE, &config).remove(0)
    }

    fn readings(faults: DetectorFaults, seed: u64) -> Readings {
        Readings::begin(plan().sensor.detectors(), faults, Seed::new(seed))
    }

    /// Notes a second with these cars on the first approach, which is 100 m long: number, position and speed.
    fn second(readings: &mut Readings, cars: &[(u64, f64, f64)]) {
        let first = cars.iter().map(|&(car, position, speed)| (CarId(car), position, speed)).collect();
        let table = CarTable::of([first, vec![], vec![], vec![]]);
        readings.second(&plan().region, CarsAt::all(&table));
    }

    /// Returns the columns of the first approach: stop bar, then advance.
    fn columns(readings: &Readings) -> [f32; 6] {
        let mut columns = [9.0; 4 * 2 * COLUMNS];
        readings.write(&mut columns);
        columns[..6].try_into().unwrap()
    }

    #[test]
    fn a_car_is_counted_once_and_seen_while_it_is_over_a_detector() {
        let mut readings = readings(DetectorFaults::default(), 1);
        assert_eq!(columns(&readings), [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        // The advance detector begins at 40 m, that of the stop line at 88 m.
        for position in [35.0, 45.0, 55.0, 65.0] {
            second(&mut readings, &[(7, position, 10.0)]);
        }
        // It is at 45 m, where it has crossed the advance detector, and then beyond it. Gap: 2 s of 60.
        assert_eq!(columns(&readings), [0.0, 0.0, 1.0, 0.5, 0.25, 2.0 / 60.0]);
        readings.decide();
        for (position, speed) in [(75.0, 10.0), (85.0, 10.0), (95.0, 10.0), (99.0, 4.0)] {
            second(&mut readings, &[(7, position, speed)]);
        }
        assert_eq!(columns(&readings), [0.5, 0.5, 0.0, 0.0, 0.0, 6.0 / 60.0]);
    }

    #[test]
    fn a_fast_car_that_crosses_the_detector_and_the_stop_line_in_one_second_counts() {
        let mut readings = readings(DetectorFaults::default(), 1);
        second(&mut readings, &[(7, 87.0, 14.0)]);
        second(&mut readings, &[]);
        assert_eq!(columns(&readings)[..3], [1.0, 0.5, 0.0]);
        second(&mut readings, &[]);
        assert_eq!(columns(&readings)[..3], [2.0 / 3.0, 1.0 / 3.0, 1.0 / 60.0]);
    }

    #[test]
    fn cars_are_between_the_detectors_from_one_to_the_other_and_forgotten_when_nobody_comes() {
        let mut readings = readings(DetectorFaults::default(), 1);
        let mut between = |cars: &[(u64, f64, f64)]| {
            second(&mut readings, cars);
            let found = readings.iter().map(|(detector, _, between)| (detector.place, between)).nth(1).unwrap();
            assert_eq!(found.0, DetectorPlace::Advance);
            found.1
        };
        assert_eq!(between(&[(7, 35.0, 10.0), (8, 25.0, 10.0)]), 0);
        assert_eq!(between(&[(7, 45.0, 10.0), (8, 35.0, 10.0)]), 1);
        assert_eq!(between(&[(7, 55.0, 10.0), (8, 45.0, 10.0)]), 2);
        assert_eq!(between(&[(7, 90.0, 10.0), (8, 55.0, 10.0)]), 1, "the first one is at the stop line");
        // The other one has changed lanes. It is forgotten after 8 s without a car at the stop line.
        assert_eq!(between(&[(7, 99.0, 10.0)]), 1);
        assert_eq!([0; 8].map(|_| between(&[])), [1, 1, 1, 1, 1, 1, 1, 0]);
    }

    #[test]
    fn dead_detectors_see_nothing_and_the_same_ones_are_dead_in_the_same_episode() {
        let dead = |dead, seed| readings(DetectorFaults { dead, noise: 0.0 }, seed).dead;
        assert_eq!(dead(1.0, 1), [true; 8]);
        assert_eq!(dead(0.5, 1), dead(0.5, 1));
        let shares = (0..500).map(|seed| dead(0.3, seed).iter().filter(|dead| **dead).count()).sum::<usize>();
        // 1200 of 4000, standard deviation 29.
        assert!((1100..1300).contains(&shares), "{shares}");
        let mut all_dead = readings(DetectorFaults { dead: 1.0, noise: 0.5 }, 1);
        second(&mut all_dead, &[(7, 95.0, 10.0)]);
        assert_eq!(columns(&all_dead), [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_noisy_detector_sees_the_opposite() {
        let mut readings = readings(DetectorFaults { dead: 0.0, noise: 1.0 }, 1);
        second(&mut readings, &[(7, 95.0, 0.0)]);
        assert_eq!(columns(&readings)[..4], [0.0, 0.0, 1.0, 1.0]);
    }
}
