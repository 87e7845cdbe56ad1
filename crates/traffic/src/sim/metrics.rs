//! The traffic metrics other than the return: means of the cars' trips from SUMO's own tripinfo output, and queues, speeds
//! and throughput per intersection. Only evaluations and baselines ask for them.

use std::fs::File;
use std::io::{Read, Seek};
use std::os::fd::AsRawFd;

use anyhow::{Context, Result};
use roxmltree::{Document, Node};

use crate::cars_at::{CarsAt, RowLanes};
use dials_core::outside::temporary_file;
use libsumo::{CarId, CarTable};

pub(crate) struct TrafficMetrics {
    /// The file to which SUMO writes the trips. It has no name, so a killed process leaves none behind.
    trip_file: File,
    trips: Option<Trips>,
    steps: u64,
    intersections: Vec<Sums>,
    /// Whether each approach of each intersection ends at its stop line.
    at_stop_line: Vec<Vec<bool>>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    car_steps: u64,
    speed_sum_mps: f64,
    halting_car_steps: u64,
    passed: u64,
}

/// Means over the trips of an episode, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Trips {
    /// From entering the net to leaving it or to the end of the episode, over all cars that entered.
    travel_time_s: f64,
    /// Time lost by driving slower than allowed and by waiting at the boundary before entering. The mean is over all
    /// cars, including those that never entered. Source: Ault and Sharon, "Reinforcement Learning Benchmarks for
    /// Traffic Signal Control" (RESCO), NeurIPS Datasets and Benchmarks 2021.
    delay_s: f64,
    /// Time below 0.1 m/s after entering. The mean is over all cars that entered.
    waiting_time_s: f64,
}

impl TrafficMetrics {
    pub(super) fn new(at_stop_line: Vec<Vec<bool>>) -> Result<Self> {
        Ok(TrafficMetrics {
            trip_file: temporary_file().context("SUMO's trips have no place")?,
            trips: None,
            steps: 0,
            intersections: vec![Sums::default(); at_stop_line.len()],
            at_stop_line,
        })
    }

    /// Returns the options that make SUMO write the trips, with the digits of a millisecond.
    pub(super) fn options(&self) -> Vec<String> {
        let place = format!("/proc/self/fd/{}", self.trip_file.as_raw_fd());
        let trips = ["--tripinfo-output", &place, "--precision", "6"];
        let of_all = ["--tripinfo-output.write-unfinished", "true", "--tripinfo-output.write-undeparted", "true"];
        trips.into_iter().chain(of_all).map(str::to_owned).collect()
    }

    pub(super) fn begin(&mut self) {
        self.trips = None;
        self.steps = 0;
        self.intersections.fill(Sums::default());
    }

    /// Notes the cars on the approaches after a step and `before` it. `gone`: those that left the road in between.
    pub(super) fn step(&mut self, approaches: &RowLanes, before: &CarTable, gone: &[CarId]) {
        self.steps += 1;
        for (row, (sums, at_stop_line)) in self.intersections.iter_mut().zip(&self.at_stop_line).enumerate() {
            let now = approaches.at(row);
            for lane in now.iter() {
                sums.car_steps += lane.len() as u64;
                sums.speed_sum_mps += lane.speeds_mps.iter().sum::<f64>();
                sums.halting_car_steps += lane.halting() as u64;
            }
            sums.passed += passed(now, approaches.of(before, row), gone, at_stop_line);
        }
    }

    pub(super) fn finished(&self) -> bool {
        self.trips.is_some()
    }

    /// Reads the trips. SUMO writes those of cars on the road when it closes the simulation, so call it after that.
    pub(super) fn finish(&mut self) -> Result<()> {
        self.trips = Some(means(&self.trips_as_text()?)?);
        Ok(())
    }

    pub(super) fn trips_as_text(&mut self) -> Result<String> {
        let mut text = String::new();
        let read = self.trip_file.rewind().and_then(|()| self.trip_file.read_to_string(&mut text));
        read.context("SUMO's trips could not be read")?;
        Ok(text)
    }

    /// Returns the metrics of the whole net; `arrived` cars left it.
    pub(super) fn of_net(&self, arrived: u64) -> [(String, f64); 5] {
        let Trips { travel_time_s, delay_s, waiting_time_s } = self.trips.expect("the episode is over");
        let halting = self.intersections.iter().map(|sums| sums.halting_car_steps).sum();
        let approaches = self.at_stop_line.iter().map(Vec::len).sum();
        [
            ("travel_time_s", travel_time_s),
            ("delay_s", delay_s),
            ("waiting_time_s", waiting_time_s),
            ("queue_length", self.per_approach_step(halting, approaches)),
            ("throughput_per_h", 3600.0 * arrived as f64 / self.steps.max(1) as f64),
        ]
        .map(|(name, value)| (name.to_owned(), value))
    }

    pub(super) fn of_agents(&self) -> [(String, Vec<f64>); 3] {
        let each = |figure: &dyn Fn(&Sums) -> f64| self.intersections.iter().map(figure).collect();
        let queues = self.intersections.iter().zip(&self.at_stop_line);
        let queues = queues.map(|(at, lanes)| self.per_approach_step(at.halting_car_steps, lanes.len())).collect();
        [
            ("mean_speed_mps", each(&|at| at.speed_sum_mps / at.car_steps.max(1) as f64)),
            ("queue_length", queues),
            ("passed", each(&|at| at.passed as f64)),
        ]
        .map(|(name, values)| (name.to_owned(), values))
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
    // A car that changed to the lane beside it is still there.
    let stayed = |car: &CarId| now.iter().any(|lane| lane.ids.contains(car));
    let passed = |car: &&CarId| !stayed(car) && !gone.contains(car);
    at_stop_line.flat_map(|(lane, _)| lane.ids).filter(passed).count() as u64
}

/// Returns the means of the trips that SUMO wrote; 0 if there are no cars.
fn means(text: &str) -> Result<Trips> {
    let document = Document::parse(text).context("SUMO's trips are not XML")?;
    let (mut sums, mut cars, mut entered) = (Trips::default(), 0_u32, 0_u32);
    for trip in document.root_element().children().filter(|node| node.has_tag_name("tripinfo")) {
        cars += 1;
        sums.delay_s += number(trip, "timeLoss")? + number(trip, "departDelay")?;
        // A car that never entered departs at -1.
        if number(trip, "depart")? >= 0.0 {
            entered += 1;
            sums.travel_time_s += number(trip, "duration")?;
            sums.waiting_time_s += number(trip, "waitingTime")?;
        }
    }
    let [cars, entered] = [cars, entered].map(|count| f64::from(count.max(1)));
    Ok(Trips {
        travel_time_s: sums.travel_time_s / entered,
        delay_s: sums.delay_s / cars,
        waiting_time_s: sums.waiting_time_s / entered,
    })
}

fn number(trip: Node<'_, '_>, name: &str) -> Result<f64> {
    let number = trip.attribute(name).and_then(|text| text.parse().ok()).filter(|number: &f64| number.is_finite());
    number.with_context(|| format!("a trip of SUMO's has no number `{name}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read<const LANES: usize>(lanes: [&[u64]; LANES]) -> CarTable {
        CarTable::of(lanes.map(|ids| ids.iter().map(|&id| (CarId(id), 50.0, 10.0)).collect()))
    }

    #[test]
    fn only_cars_that_cross_a_stop_line_have_passed() {
        // Lanes 0 and 1 end at the stop line, lane 2 leads to lane 0 through a junction without a light.
        let before = read([&[1, 2, 5], &[6], &[3, 4]]);
        // Car 1 crosses the stop line, 2 changes lanes, 3 comes nearer, 4 is within the junction, 5 ends its trip on its
        // approach, 6 is teleported, and 7 is new.
        let now = read([&[7, 3], &[2], &[]]);
        let gone = [CarId(5), CarId(6)];
        assert_eq!(passed(CarsAt::all(&now), CarsAt::all(&before), &gone, &[true, true, false]), 1);
    }

    #[test]
    fn an_episode_without_cars_or_steps_has_figures_that_are_numbers() {
        let mut metrics = TrafficMetrics::new(vec![vec![true; 4], vec![true; 3]]).unwrap();
        metrics.trips = Some(means("<tripinfos/>").unwrap());
        assert!(metrics.of_net(0).iter().all(|(_, value)| *value == 0.0));
        assert!(metrics.of_agents().iter().all(|(_, values)| values == &[0.0, 0.0]));
    }

    #[test]
    fn a_torn_file_or_a_number_that_is_none_is_an_error() {
        assert_eq!(means("<tripinfos>").unwrap_err().to_string(), "SUMO's trips are not XML");
        for odd in ["nan", "inf", "", "1e999"] {
            let text = format!("<tripinfos><tripinfo depart=\"1\" timeLoss=\"{odd}\" departDelay=\"0\"/></tripinfos>");
            assert_eq!(means(&text).unwrap_err().to_string(), "a trip of SUMO's has no number `timeLoss`", "{odd}");
        }
    }
}
