//! The traffic metrics other than the return: means of the cars' trips from SUMO's own output, and queues, speeds and
//! throughput per intersection. Only evaluations and baselines ask for them. Training and collection do not measure
//! them and pay nothing.

use anyhow::Result;

use super::trips::{TripFile, Trips};
use crate::sumo::{CarTable, LaneCars};
use crate::traffic::agents::region::EDGES;

/// The metrics of an episode.
pub struct TrafficMetrics {
    trip_file: TripFile,
    /// Means of the trips, known when the episode is over.
    trips: Option<Trips>,
    steps: u64,
    intersections: Vec<Sums>,
}

/// Sums over the steps and the incoming edges of one intersection.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    car_steps: u64,
    speed_sum_mps: f64,
    halting_car_steps: u64,
    passed: u64,
}

impl TrafficMetrics {
    pub fn new(agents: usize) -> Result<Self> {
        Ok(TrafficMetrics {
            trip_file: TripFile::new()?,
            trips: None,
            steps: 0,
            intersections: vec![Sums::default(); agents],
        })
    }

    /// Returns the options that SUMO must be loaded with.
    pub fn options(&self) -> [String; 8] {
        self.trip_file.options()
    }

    pub fn begin(&mut self) {
        self.trips = None;
        self.steps = 0;
        self.intersections.fill(Sums::default());
    }

    /// Notes the cars on all incoming lanes, after a step and before it.
    pub fn step(&mut self, now: &CarTable, before: &CarTable) {
        self.steps += 1;
        for (lane, (now, before)) in now.iter().zip(before.iter()).enumerate() {
            let intersection = &mut self.intersections[lane / EDGES];
            intersection.car_steps += now.len() as u64;
            intersection.speed_sum_mps += now.speeds_mps.iter().sum::<f64>();
            intersection.halting_car_steps += now.halting() as u64;
            intersection.passed += left(now, before);
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
        let halting: u64 = self.intersections.iter().map(|intersection| intersection.halting_car_steps).sum();
        vec![
            ("travel_time_s", travel_time_s),
            ("delay_s", delay_s),
            ("waiting_time_s", waiting_time_s),
            ("queue_length", self.per_edge_step(halting, self.intersections.len())),
            ("throughput_per_h", 3600.0 * arrived as f64 / self.steps.max(1) as f64),
        ]
    }

    /// Returns the metrics of every intersection.
    pub fn of_agents(&self) -> Vec<(&'static str, Vec<f64>)> {
        let each = |figure: &dyn Fn(&Sums) -> f64| self.intersections.iter().map(figure).collect();
        vec![
            ("mean_speed_mps", each(&|at| at.speed_sum_mps / at.car_steps.max(1) as f64)),
            ("queue_length", each(&|at| self.per_edge_step(at.halting_car_steps, 1))),
            ("passed", each(&|at| at.passed as f64)),
        ]
    }

    /// Returns the text that SUMO wrote about the trips.
    #[cfg(test)]
    pub fn trips_as_text(mut self) -> String {
        self.trip_file.text().expect("the trips of an episode")
    }

    fn per_edge_step(&self, sum: u64, intersections: usize) -> f64 {
        sum as f64 / ((EDGES * intersections) as u64 * self.steps.max(1)) as f64
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
        let mut metrics = TrafficMetrics::new(2).unwrap();
        metrics.begin();
        metrics.trips = Some(Trips::default());
        assert!(metrics.of_net(0).iter().all(|(_, value)| *value == 0.0));
        assert!(metrics.of_agents().iter().all(|(_, values)| values == &[0.0, 0.0]));
    }
}
