//! The traffic metrics other than the return: means of the cars' trips from SUMO's own tripinfo output, and queues, speeds
//! and throughput per intersection. Only evaluations and baselines ask for them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::os::fd::AsRawFd;

use anyhow::{Context, Result};
use roxmltree::Document;

use super::trips::{AllTrips, Trip, number};
use crate::cars_at::{CarsAt, RowLanes};
use crate::scenario::travellers::Travellers;
use dials_core::outside::temporary_file;
use libsumo::{CarId, CarTable};

pub(crate) struct TrafficMetrics {
    /// The file to which SUMO writes the trips. It has no name, so a killed process leaves none behind.
    trip_file: File,
    /// The file to which SUMO writes counts of every step, if it may remove vehicles that could not enter.
    count_file: Option<File>,
    trips: Option<Trips>,
    /// All trips of the episode, once it is over.
    all_trips: AllTrips,
    window: Window,
    measures_emissions: bool,
    /// Number of cars that have left the net in the warm-up.
    pub(super) arrived_in_warm_up: u64,
    steps: u64,
    intersections: Vec<Sums>,
    /// Whether each approach of each intersection ends at its stop line.
    at_stop_line: Vec<Vec<bool>>,
    /// `None`: a grid of the paper, which has cars only.
    travellers: Option<Travellers>,
    /// Seconds that persons have stood at crossings with a signal.
    person_waiting_s: u64,
}

/// The seconds of an episode, and how many of them at its beginning are not counted.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Window {
    /// Seconds of SUMO's clock.
    pub(super) begin_s: u64,
    pub(super) end_s: f64,
    pub(super) warm_up_s: u64,
}

impl Window {
    /// Returns whether a trip is counted: the car wanted to enter after the warm-up. These are the same cars whatever the lights do.
    fn counts(&self, trip: &Trip) -> bool {
        self.warm_up_s == 0 || trip.wished_s(self.end_s) >= (self.begin_s + self.warm_up_s) as f64
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    car_steps: u64,
    speed_sum_mps: f64,
    halting_car_steps: u64,
    passed: u64,
}

/// Means over the trips of an episode, in seconds.
#[derive(Clone, Debug, Default, PartialEq)]
struct Trips {
    /// From entering the net to leaving it or to the end of the episode, over all cars that entered.
    travel_time_s: f64,
    /// Time lost by driving slower than allowed and by waiting at the boundary before entering. The mean is over all
    /// cars, including those that never entered. Source: Ault and Sharon, "Reinforcement Learning Benchmarks for
    /// Traffic Signal Control" (RESCO), NeurIPS Datasets and Benchmarks 2021.
    delay_s: f64,
    /// Time below 0.1 m/s after entering. The mean is over all cars that entered.
    waiting_time_s: f64,
    /// Delays of the cars of each class, but for those that SUMO removed before they entered.
    delay_of_class_s: BTreeMap<String, f64>,
    /// Number of cars that SUMO has taken out: because they could not enter, or out of a jam.
    removed: u64,
    persons: u64,
    /// How often a car came to a stand. The mean is over all cars that entered.
    stops: f64,
    /// Mass of CO2 and of fuel per car that entered, in grams, if they are measured, and of all cars together, in kilograms.
    emissions: Option<[f64; 3]>,
}

impl TrafficMetrics {
    /// `window`: its end is known when the episode is over.
    pub(super) fn new(at_stop_line: Vec<Vec<bool>>, travellers: Option<Travellers>, window: Window) -> Result<Self> {
        let may_remove = travellers.as_ref().is_some_and(|travellers| travellers.removed_after_s.is_some());
        Ok(TrafficMetrics {
            trip_file: temporary_file().context("SUMO's trips have no place")?,
            count_file: may_remove.then(temporary_file).transpose().context("SUMO's counts have no place")?,
            trips: None,
            all_trips: AllTrips::default(),
            window,
            measures_emissions: false,
            arrived_in_warm_up: 0,
            steps: 0,
            intersections: vec![Sums::default(); at_stop_line.len()],
            at_stop_line,
            travellers,
            person_waiting_s: 0,
        })
    }

    /// Returns whether there are persons, whose waiting is to be noted.
    pub(super) fn has_persons(&self) -> bool {
        self.travellers.as_ref().is_some_and(|travellers| travellers.has_persons)
    }

    /// Makes SUMO compute emissions.
    pub(super) fn measure_emissions(&mut self) {
        self.measures_emissions = true;
    }

    pub(super) fn measures_emissions(&self) -> bool {
        self.measures_emissions
    }

    /// Notes how many persons stand at crossings in this second.
    pub(super) fn note_waiting(&mut self, persons: u64) {
        self.person_waiting_s += persons;
    }

    /// Returns the options that make SUMO write the trips, with the digits of a millisecond.
    pub(super) fn options(&self) -> Vec<String> {
        let place = |file: &File| format!("/proc/self/fd/{}", file.as_raw_fd());
        let trips = ["--tripinfo-output".to_owned(), place(&self.trip_file)];
        let of_all = ["--tripinfo-output.write-unfinished", "true", "--tripinfo-output.write-undeparted", "true"];
        let counts = self.count_file.iter().flat_map(|file| ["--summary-output".to_owned(), place(file)]);
        let others = ["--precision", "6"].into_iter().chain(of_all).map(str::to_owned);
        trips.into_iter().chain(counts).chain(others).collect()
    }

    pub(super) fn begin(&mut self) {
        self.trips = None;
        self.arrived_in_warm_up = 0;
        self.steps = 0;
        self.person_waiting_s = 0;
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
    ///
    /// `end_s`: SUMO's clock at the end.
    pub(super) fn finish(&mut self, end_s: f64) -> Result<()> {
        self.window.end_s = end_s;
        let no_classes = BTreeMap::new();
        let travellers = self.travellers.as_ref();
        let class_of = travellers.map_or(&no_classes, |travellers| &travellers.class_of);
        let not_entered = match (&mut self.count_file, travellers.and_then(|travellers| travellers.removed_after_s)) {
            (Some(file), Some(waited_s)) => Removed { cars: never_entered(&end_of(file)?)?, waited_s },
            _ => Removed::default(),
        };
        let all = AllTrips::read(&text_of(&mut self.trip_file)?)?;
        self.trips = Some(means(&all, |trip| self.window.counts(trip), class_of, not_entered));
        self.all_trips = all;
        Ok(())
    }

    /// Returns all trips that are counted, once the episode is over.
    pub(super) fn counted_trips(&self) -> impl Iterator<Item = &Trip> {
        self.all_trips.cars.iter().filter(|trip| self.window.counts(trip))
    }

    #[cfg(test)]
    pub(super) fn trips_as_text(&mut self) -> Result<String> {
        text_of(&mut self.trip_file)
    }

    /// Returns the metrics of the whole net; `arrived` cars left it.
    pub(super) fn of_net(&self, arrived: u64) -> Vec<(String, f64)> {
        let trips = self.trips.as_ref().expect("the episode is over");
        let halting = self.intersections.iter().map(|sums| sums.halting_car_steps).sum();
        let approaches = self.at_stop_line.iter().map(Vec::len).sum();
        let of_all = [
            ("travel_time_s", trips.travel_time_s),
            ("delay_s", trips.delay_s),
            ("waiting_time_s", trips.waiting_time_s),
            ("queue_length", self.per_approach_step(halting, approaches)),
            ("throughput_per_h", 3600.0 * (arrived - self.arrived_in_warm_up) as f64 / self.steps.max(1) as f64),
        ];
        let mut all: Vec<(String, f64)> = of_all.map(|(name, value)| (name.to_owned(), value)).into();
        all.extend(self.of_travellers(trips));
        all.push(("stops_per_car".to_owned(), trips.stops));
        let names = ["co2_g_per_car", "fuel_g_per_car", "co2_kg"].map(str::to_owned);
        all.extend(trips.emissions.into_iter().flat_map(|figures| names.clone().into_iter().zip(figures)));
        all
    }

    fn of_travellers(&self, trips: &Trips) -> Vec<(String, f64)> {
        let mut all = Vec::new();
        let Some(travellers) = &self.travellers else { return all };
        all.push(("removed".to_owned(), trips.removed as f64));
        if let [_, _, ..] = travellers.classes[..] {
            let delay_s = |class: &String| trips.delay_of_class_s.get(class).copied().unwrap_or(0.0);
            all.extend(travellers.classes.iter().map(|class| (format!("delay_s_{class}"), delay_s(class))));
        }
        if travellers.has_persons {
            let waited_s = self.person_waiting_s as f64 / trips.persons.max(1) as f64;
            all.extend([("persons".to_owned(), trips.persons as f64), ("person_wait_s".to_owned(), waited_s)]);
        }
        all
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

/// Cars that SUMO has removed because they could not enter for so long. SUMO writes no trips of them.
#[derive(Clone, Copy, Debug, Default)]
struct Removed {
    cars: u64,
    waited_s: f64,
}

fn text_of(file: &mut File) -> Result<String> {
    let mut text = String::new();
    let read = file.rewind().and_then(|()| file.read_to_string(&mut text));
    read.context("what SUMO measured could not be read")?;
    Ok(text)
}

/// Returns the end of a file. SUMO writes a line for each step, and only the last one matters.
fn end_of(file: &mut File) -> Result<String> {
    const LAST_BYTES: u64 = 4096;
    let length = file.metadata().context("what SUMO counted could not be read")?.len();
    let mut bytes = Vec::new();
    let read = file.seek(SeekFrom::Start(length.saturating_sub(LAST_BYTES))).and_then(|_| file.read_to_end(&mut bytes));
    read.context("what SUMO counted could not be read")?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Returns how many vehicles SUMO has removed before they entered. `counts`: the end of its counts of all steps.
fn never_entered(counts: &str) -> Result<u64> {
    let Some(begin) = counts.rfind("<step ") else { return Ok(0) };
    let line = &counts[begin..];
    let end = line.find("/>").map_or(line.len(), |end| end + "/>".len());
    let document = Document::parse(&line[..end]).context("SUMO's counts are not XML")?;
    let last = document.root_element();
    Ok((number(last, "ended")? - number(last, "arrived")?) as u64)
}

/// Returns the means of the trips that are counted; 0 if there are no cars. A car that was removed before it entered counts as
/// one that never entered.
fn means(
    all: &AllTrips,
    counts: impl Fn(&Trip) -> bool,
    class_of: &BTreeMap<String, String>,
    never_entered: Removed,
) -> Trips {
    let (mut sums, mut cars, mut entered) = (Trips::default(), never_entered.cars, 0_u32);
    sums.delay_s = never_entered.cars as f64 * never_entered.waited_s;
    sums.removed = never_entered.cars;
    sums.persons = all.persons;
    let mut of_classes: BTreeMap<&str, (f64, u32)> = BTreeMap::new();
    for trip in all.cars.iter().filter(|trip| counts(trip)) {
        cars += 1;
        let delay_s = trip.delay_s();
        sums.delay_s += delay_s;
        if let Some(class) = class_of.get(&trip.vehicle_type) {
            let (sum_s, count) = of_classes.entry(class).or_default();
            (*sum_s, *count) = (*sum_s + delay_s, *count + 1);
        }
        sums.removed += u64::from(trip.removed);
        if trip.entered() {
            entered += 1;
            sums.travel_time_s += trip.duration_s;
            sums.waiting_time_s += trip.waiting_s;
            sums.stops += trip.stops;
        }
        if let Some([co2_mg, fuel_mg]) = trip.emissions {
            let [co2, fuel, _] = sums.emissions.get_or_insert([0.0; 3]);
            (*co2, *fuel) = (*co2 + co2_mg, *fuel + fuel_mg);
        }
    }
    sums.delay_of_class_s =
        of_classes.into_iter().map(|(class, (sum_s, count))| (class.to_owned(), sum_s / f64::from(count))).collect();
    let (cars, entered) = (cars.max(1) as f64, f64::from(entered.max(1)));
    Trips {
        travel_time_s: sums.travel_time_s / entered,
        delay_s: sums.delay_s / cars,
        waiting_time_s: sums.waiting_time_s / entered,
        stops: sums.stops / entered,
        emissions: sums.emissions.map(|[co2, fuel, _]| [co2 / 1e3 / entered, fuel / 1e3 / entered, co2 / 1e6]),
        ..sums
    }
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

    fn of(text: &str) -> Result<Trips> {
        let class_of =
            BTreeMap::from([("car", "passenger"), ("bus", "bus")].map(|(id, class)| (id.to_owned(), class.to_owned())));
        let all = AllTrips::read(&format!("<tripinfos>{text}</tripinfos>"))?;
        Ok(means(&all, |_| true, &class_of, Removed { cars: 2, waited_s: 30.0 }))
    }

    #[test]
    fn cars_that_sumo_removed_count_as_such_that_never_entered_and_classes_have_delays_of_their_own() {
        let trip = |kind: &str, depart: i32, loss: f64, vaporized: &str| {
            format!(
                "<tripinfo depart='{depart}' duration='100' waitingTime='5' waitingCount='2' timeLoss='{loss}' departDelay='10' vType='{kind}' \
                 vaporized='{vaporized}'/>"
            )
        };
        let text = [
            trip("car", 1, 20.0, ""),
            trip("bus", 2, 40.0, "teleport"),
            trip("bus", -1, 0.0, "end"),
            "<personinfo id='p'/>".to_owned(),
        ];
        let trips = of(&text.concat()).unwrap();
        // 30 + 50 + 10 s of three cars, and 30 s of each that never entered.
        assert_eq!((trips.delay_s, trips.removed, trips.persons), (30.0, 3, 1));
        assert_eq!((trips.travel_time_s, trips.waiting_time_s, trips.stops), (100.0, 5.0, 2.0));
        assert_eq!(trips.delay_of_class_s, BTreeMap::from([("passenger".to_owned(), 30.0), ("bus".to_owned(), 30.0)]));
        let counts = "<summary><step ended='1' arrived='1'/><step ended='9' arrived='6'/></summary>";
        assert_eq!(never_entered(counts).unwrap(), 3);
        assert_eq!(never_entered("<summary/>").unwrap(), 0);
    }

    #[test]
    fn the_cars_of_the_warm_up_are_those_that_wanted_to_enter_in_it_whenever_they_did() {
        let window = Window { begin_s: 100, end_s: 1000.0, warm_up_s: 300 };
        let trip = |depart_s, depart_delay_s| Trip { depart_s, depart_delay_s, ..Trip::default() };
        // Wanted to enter at 390 and entered at 500; at 400; never entered and waits since 350, since 450.
        let trips = [trip(500.0, 110.0), trip(400.0, 0.0), trip(-1.0, 650.0), trip(-1.0, 550.0)];
        assert_eq!(trips.map(|trip| window.counts(&trip)), [false, true, false, true]);
        assert!(Window { warm_up_s: 0, ..window }.counts(&trip(0.0, 0.0)));
    }

    #[test]
    fn an_episode_without_cars_or_steps_has_figures_that_are_numbers() {
        let mut metrics = TrafficMetrics::new(vec![vec![true; 4], vec![true; 3]], None, Window::default()).unwrap();
        metrics.trips = Some(means(&AllTrips::default(), |_| true, &BTreeMap::new(), Removed::default()));
        assert!(metrics.of_net(0).iter().all(|(_, value)| *value == 0.0));
        assert!(metrics.of_agents().iter().all(|(_, values)| values == &[0.0, 0.0]));
    }

    #[test]
    fn a_torn_file_or_a_number_that_is_none_is_an_error() {
        let torn = AllTrips::read("<tripinfos>").unwrap_err();
        assert_eq!(torn.to_string(), "SUMO's trips are not XML");
        for odd in ["nan", "inf", "", "1e999"] {
            let text = format!("<tripinfo depart=\"1\" timeLoss=\"{odd}\" departDelay=\"0\"/>");
            assert_eq!(of(&text).unwrap_err().to_string(), "a trip of SUMO's has no number `timeLoss`", "{odd}");
        }
    }
}
