//! The traffic metrics other than the return: means of the cars' trips from SUMO's own output, and queues, speeds and
//! throughput per intersection. Only evaluations and baselines ask for them. Training and collection do not measure
//! them and pay nothing.

use anyhow::Result;

use super::trips::{TripFile, Trips};
use crate::sumo::LaneCars;
use crate::traffic::cars_at::CarsAt;

/// The metrics of an episode.
pub struct TrafficMetrics {
    trip_file: TripFile,
    /// Means of the trips, known when the episode is over.
    trips: Option<Trips>,
    steps: u64,
    intersections: Vec<Sums>,
}

/// Sums over the steps and the approaches of one intersection.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    approaches: u64,
    car_steps: u64,
    speed_sum_mps: f64,
    halting_car_steps: u64,
    passed: u64,
}

impl TrafficMetrics {
    /// Makes the metrics of intersections with these numbers of approaches.
    pub fn new(approaches: impl Iterator<Item = usize>) -> Result<Self> {
        let begin = |approaches| Sums { approaches: approaches as u64, ..Sums::default() };
        Ok(TrafficMetrics {
            trip_file: TripFile::new()?,
            trips: None,
            steps: 0,
            intersections: approaches.map(begin).collect(),
        })
    }

    /// Returns the options that SUMO must be loaded with.
    pub fn options(&self) -> [String; 8] {
        self.trip_file.options()
    }

    pub fn begin(&mut self) {
        self.trips = None;
        self.steps = 0;
        for sums in &mut self.intersections {
            *sums = Sums { approaches: sums.approaches, ..Sums::default() };
        }
    }

    /// Notes that a step is over.
    pub fn step(&mut self) {
        self.steps += 1;
    }

    /// Notes the cars on the approaches of an intersection, after a step and before it.
    pub fn cars(&mut self, row: usize, now: CarsAt<'_>, before: CarsAt<'_>) {
        let sums = &mut self.intersections[row];
        for (now, before) in now.iter().zip(before.iter()) {
            sums.car_steps += now.len() as u64;
            sums.speed_sum_mps += now.speeds_mps.iter().sum::<f64>();
            sums.halting_car_steps += now.halting() as u64;
            sums.passed += left(now, before);
        }
    }

    /// Returns whether [`TrafficMetrics::finish`] was called since the beginning.
    pub fn finished(&self) -> bool {
        self.trips.is_some()
    }

    /// Reads the trips. Call it when SUMO has closed the simulation of the episode.
    pub fn finish(&mut self) -> Result<()> {
        self.trips = Some(self.trip_file.read()?);
        Ok(())
    }

    /// Returns the metrics of the whole net; `arrived` cars left it.
    pub fn of_net(&self, arrived: u64) -> Vec<(&'static str, f64)> {
        let Trips { travel_time_s, delay_s, waiting_time_s } = self.trips.expect("the episode is over");
        let sum = |of: fn(&Sums) -> u64| self.intersections.iter().map(of).sum();
        let (halting, approaches) = (sum(|sums| sums.halting_car_steps), sum(|sums| sums.approaches));
        vec![
            ("travel_time_s", travel_time_s),
            ("delay_s", delay_s),
            ("waiting_time_s", waiting_time_s),
            ("queue_length", self.per_approach_step(halting, approaches)),
            ("throughput_per_h", 3600.0 * arrived as f64 / self.steps.max(1) as f64),
        ]
    }

    /// Returns the metrics of every intersection.
    pub fn of_agents(&self) -> Vec<(&'static str, Vec<f64>)> {
        let each = |figure: &dyn Fn(&Sums) -> f64| self.intersections.iter().map(figure).collect();
        vec![
            ("mean_speed_mps", each(&|at| at.speed_sum_mps / at.car_steps.max(1) as f64)),
            ("queue_length", each(&|at| self.per_approach_step(at.halting_car_steps, at.approaches))),
            ("passed", each(&|at| at.passed as f64)),
        ]
    }

    /// Returns the text that SUMO wrote about the trips.
    #[cfg(test)]
    pub fn trips_as_text(mut self) -> String {
        self.trip_file.text().expect("the trips of an episode")
    }

    fn per_approach_step(&self, sum: u64, approaches: u64) -> f64 {
        sum as f64 / (approaches.max(1) * self.steps.max(1)) as f64
    }
}

/// Returns the number of cars that left a lane between two reads, however many came.
fn left(now: LaneCars<'_>, before: LaneCars<'_>) -> u64 {
    before.ids.iter().filter(|car| !now.ids.contains(car)).count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sumo::CarId;

    fn lane(ids: &[CarId]) -> LaneCars<'_> {
        const NUMBERS: [f64; 3] = [0.0; 3];
        LaneCars { ids, positions_m: &NUMBERS[..ids.len()], speeds_mps: &NUMBERS[..ids.len()] }
    }

    #[test]
    fn cars_that_left_are_counted_however_many_came() {
        let [a, b, c] = [CarId(1), CarId(2), CarId(3)];
        assert_eq!(left(lane(&[c]), lane(&[b, a])), 2);
        assert_eq!(left(lane(&[b, a]), lane(&[b, a])), 0);
        // On an odd net, several cars may come at once, ahead of others, or in another order.
        assert_eq!(left(lane(&[a, b, c]), lane(&[])), 0);
        assert_eq!(left(lane(&[a, c, b]), lane(&[b, a])), 0);
        assert_eq!(left(lane(&[]), lane(&[])), 0);
    }

    #[test]
    fn an_episode_without_cars_or_steps_has_figures_that_are_numbers() {
        let mut metrics = TrafficMetrics::new([4, 3].into_iter()).unwrap();
        metrics.begin();
        metrics.trips = Some(Trips::default());
        assert!(metrics.of_net(0).iter().all(|(_, value)| *value == 0.0));
        assert!(metrics.of_agents().iter().all(|(_, values)| values == &[0.0, 0.0]));
    }
}
