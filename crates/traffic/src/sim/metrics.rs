//! The traffic metrics other than the return: means of the cars' trips from SUMO's own output, and queues, speeds and
//! throughput per intersection. Only evaluations and baselines ask for them. Training and collection do not measure
//! them and pay nothing.

use anyhow::Result;

use super::trips::{TripFile, Trips};
use crate::cars_at::CarsAt;
use libsumo::{CarId, LaneCars};

/// The metrics of an episode.
pub(crate) struct TrafficMetrics {
    trip_file: TripFile,
    /// Means of the trips, known when the episode is over.
    trips: Option<Trips>,
    steps: u64,
    intersections: Vec<Sums>,
    /// Whether each approach of each intersection ends at its stop line.
    at_stop_line: Vec<Vec<bool>>,
}

/// Sums over the steps and the approaches of one intersection.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    car_steps: u64,
    speed_sum_mps: f64,
    halting_car_steps: u64,
    passed: u64,
}

impl TrafficMetrics {
    /// Makes the metrics of intersections. `at_stop_line`: for each of them, whether each approach ends at its stop line.
    pub(crate) fn new(at_stop_line: Vec<Vec<bool>>) -> Result<Self> {
        Ok(TrafficMetrics {
            trip_file: TripFile::new()?,
            trips: None,
            steps: 0,
            intersections: vec![Sums::default(); at_stop_line.len()],
            at_stop_line,
        })
    }

    /// Returns the options that SUMO must be loaded with.
    pub(crate) fn options(&self) -> [String; 8] {
        self.trip_file.options()
    }

    pub(crate) fn begin(&mut self) {
        self.trips = None;
        self.steps = 0;
        self.intersections.fill(Sums::default());
    }

    /// Notes that a step is over.
    pub(crate) fn step(&mut self) {
        self.steps += 1;
    }

    /// Notes the cars on the approaches of an intersection, after a step and before it. `gone`: those that left the road
    /// in between.
    pub(crate) fn cars(&mut self, row: usize, now: CarsAt<'_>, before: CarsAt<'_>, gone: &[CarId]) {
        let sums = &mut self.intersections[row];
        for lane in now.iter() {
            sums.car_steps += lane.len() as u64;
            sums.speed_sum_mps += lane.speeds_mps.iter().sum::<f64>();
            sums.halting_car_steps += lane.halting() as u64;
        }
        sums.passed += passed(now, before, gone, &self.at_stop_line[row]);
    }

    /// Returns whether [`TrafficMetrics::finish`] was called since the beginning.
    pub(crate) fn finished(&self) -> bool {
        self.trips.is_some()
    }

    /// Reads the trips. Call it when SUMO has closed the simulation of the episode.
    pub(crate) fn finish(&mut self) -> Result<()> {
        self.trips = Some(self.trip_file.read()?);
        Ok(())
    }

    /// Returns the metrics of the whole net; `arrived` cars left it.
    pub(crate) fn of_net(&self, arrived: u64) -> Vec<(&'static str, f64)> {
        let Trips { travel_time_s, delay_s, waiting_time_s } = self.trips.expect("the episode is over");
        let sum = |of: fn(&Sums) -> u64| self.intersections.iter().map(of).sum();
        let approaches = self.at_stop_line.iter().map(Vec::len).sum();
        vec![
            ("travel_time_s", travel_time_s),
            ("delay_s", delay_s),
            ("waiting_time_s", waiting_time_s),
            ("queue_length", self.per_approach_step(sum(|sums| sums.halting_car_steps), approaches)),
            ("throughput_per_h", 3600.0 * arrived as f64 / self.steps.max(1) as f64),
        ]
    }

    /// Returns the metrics of every intersection.
    pub(crate) fn of_agents(&self) -> Vec<(&'static str, Vec<f64>)> {
        let each = |figure: &dyn Fn(&Sums) -> f64| self.intersections.iter().map(figure).collect();
        let queues = self.intersections.iter().zip(&self.at_stop_line);
        let queues = queues.map(|(at, lanes)| self.per_approach_step(at.halting_car_steps, lanes.len())).collect();
        vec![
            ("mean_speed_mps", each(&|at| at.speed_sum_mps / at.car_steps.max(1) as f64)),
            ("queue_length", queues),
            ("passed", each(&|at| at.passed as f64)),
        ]
    }

    /// Returns the text that SUMO wrote about the trips.
    #[cfg(test)]
    pub(crate) fn trips_as_text(mut self) -> String {
        self.trip_file.text().expect("the trips of an episode")
    }

    fn per_approach_step(&self, sum: u64, approaches: usize) -> f64 {
        sum as f64 / (approaches.max(1) as u64 * self.steps.max(1)) as f64
    }
}

/// Returns the number of cars that crossed a stop line between two reads of a light's approaches. `gone`: cars that ended
/// their trip or began to teleport in between. `at_stop_line`: whether each approach ends there.
///
/// A car that leaves an approach for a lane beside it that is no approach counts as well.
pub(crate) fn passed(now: CarsAt<'_>, before: CarsAt<'_>, gone: &[CarId], at_stop_line: &[bool]) -> u64 {
    let at_stop_line = before.iter().zip(at_stop_line).filter(|&(_, &at_stop_line)| at_stop_line);
    at_stop_line.map(|(lane, _)| left(now, lane, gone)).sum()
}

/// Returns the number of cars of an approach that are elsewhere on the road after a step, and on no approach of the light,
/// however many came. A car that changed to the lane beside it is still there.
fn left(now: CarsAt<'_>, before: LaneCars<'_>, gone: &[CarId]) -> u64 {
    let stayed = |car: &CarId| now.iter().any(|lane| lane.ids.contains(car));
    before.ids.iter().filter(|car| !stayed(car) && !gone.contains(car)).count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use libsumo::CarTable;

    fn read<const LANES: usize>(lanes: [&[u64]; LANES]) -> CarTable {
        CarTable::of(lanes.map(|ids| ids.iter().map(|&id| (CarId(id), 50.0, 10.0)).collect()))
    }

    #[test]
    fn cars_that_left_are_counted_however_many_came() {
        let left_of = |now: &[u64], before: &[u64]| {
            let (now, before) = (read([now]), read([before]));
            left(CarsAt::new(&now, 0, 1), before.lane(0), &[])
        };
        assert_eq!(left_of(&[3], &[2, 1]), 2);
        assert_eq!(left_of(&[2, 1], &[2, 1]), 0);
        // On an odd net, several cars may come at once, ahead of others, or in another order.
        assert_eq!(left_of(&[1, 2, 3], &[]), 0);
        assert_eq!(left_of(&[1, 3, 2], &[2, 1]), 0);
        assert_eq!(left_of(&[], &[]), 0);
    }

    #[test]
    fn only_cars_that_cross_a_stop_line_have_passed() {
        // Lanes 0 and 1 end at the stop line, lane 2 leads to lane 0 through a junction without a light.
        let mut metrics = TrafficMetrics::new(vec![vec![true, true, false]]).unwrap();
        let before = read([&[1, 2, 5], &[6], &[3, 4]]);
        // Car 1 crosses the stop line, 2 changes lanes, 3 comes nearer, 4 is within the junction, 5 ends its trip on its
        // approach, and 6 is teleported.
        let now = read([&[3], &[2], &[]]);
        metrics.cars(0, CarsAt::new(&now, 0, 3), CarsAt::new(&before, 0, 3), &[CarId(5), CarId(6)]);
        let (_, passed) = metrics.of_agents().into_iter().find(|(name, _)| *name == "passed").unwrap();
        assert_eq!(passed, [1.0]);
    }

    #[test]
    fn an_episode_without_cars_or_steps_has_figures_that_are_numbers() {
        let mut metrics = TrafficMetrics::new(vec![vec![true; 4], vec![true; 3]]).unwrap();
        metrics.begin();
        metrics.trips = Some(Trips::default());
        assert!(metrics.of_net(0).iter().all(|(_, value)| *value == 0.0));
        assert!(metrics.of_agents().iter().all(|(_, values)| values == &[0.0, 0.0]));
    }
}
