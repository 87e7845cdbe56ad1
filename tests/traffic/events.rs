//! The event log of the street, beside what the recording of the same episode says. Plain SUMO plays the recording to the
//! last bit, so its FCD output has the same cars in the same places.

use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use assert_cmd::Command;
use dials_core::base::Seed;
use dials_core::domain::{Baseline, Domain};
use dials_learn::evaluation::{EpisodeReport, play};
use dials_traffic::Traffic;
use dials_traffic::config::ScenarioConfig;
use dials_traffic::events::site::{Detector, DetectorPlace, PhaseKind, Site};
use dials_traffic::events::{Event, EventLog, code};
use dials_traffic::sim::recording::{Recording, Tape};
use libsumo::CarId;

const SECONDS: u64 = 900;

fn town() -> Traffic {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/town/town.sumocfg");
    let config = ScenarioConfig { begin_s: Some(0), end_s: Some(SECONDS), ..ScenarioConfig::new(file) };
    Traffic::open_scenario(&config).unwrap()
}

fn played(traffic: &Traffic) -> EpisodeReport {
    let Baseline { mut simulator, mut controller } = traffic.baseline("program").unwrap();
    simulator.measure_in_full().unwrap();
    play(&mut *simulator, &mut *controller, Seed::new(3).for_episode(0)).unwrap()
}

struct Logged {
    sites: Vec<Site>,
    events: Vec<Event>,
    recording: Recording,
    report: EpisodeReport,
}

/// Returns a quarter of an hour of the town under its own programs. It is played once.
fn logged() -> &'static Logged {
    static LOGGED: OnceLock<Logged> = OnceLock::new();
    LOGGED.get_or_init(|| {
        let (tape, log) = (Tape::default(), EventLog::default());
        let traffic = town().record_on(&tape).log_events(&log);
        let report = played(&traffic);
        let sites = traffic.sites().unwrap();
        Logged { sites, events: log.take(), recording: tape.take().unwrap(), report }
    })
}

impl Logged {
    fn detectors(&self, place: DetectorPlace) -> impl Iterator<Item = (usize, u16, &Detector)> {
        let of_site = |site: &'static Site| site.detectors.iter().zip(1..);
        let all = logged().sites.iter().enumerate();
        let all = all.flat_map(move |(number, site)| of_site(site).map(move |(detector, id)| (number, id, detector)));
        all.filter(move |(_, _, detector)| detector.place == place)
    }

    /// Returns where each car is after each second: its lane and its place there.
    fn places(&self) -> Vec<HashMap<CarId, (&str, f64)>> {
        let lanes = &self.recording.roads.lanes;
        let of_second = |step: &'static dials_traffic::sim::recording::Step| {
            let cars = lanes.iter().enumerate().flat_map(|(number, lane)| {
                step.cars.lane(number).iter().map(|car| (car.id, (&**lane, car.position_m))).collect::<Vec<_>>()
            });
            cars.collect()
        };
        logged().recording.steps.iter().map(of_second).collect()
    }

    fn has_green(&self, site: usize, phase: u16, second: usize) -> bool {
        let (light, phase) = (&self.sites[site].light, &self.sites[site].phases[usize::from(phase) - 1]);
        let number = self.recording.roads.lights.iter().position(|other| other == light).unwrap();
        let state = self.recording.steps[second].signals[number].as_str().as_bytes();
        phase.letters.iter().any(|&letter| b"Gg".contains(&state[letter]))
    }
}

fn edge(lane: &str) -> &str {
    lane.rsplit_once('_').unwrap().0
}

#[test]
fn cars_arrive_when_their_places_say_so_and_in_the_same_light() {
    let logged = logged();
    let places = logged.places();
    let (mut arrivals, mut on_green, mut differ) = (0, 0, 0);
    // At a shorter distance from its beginning, a car may come from the lane before.
    for (site, id, detector) in logged.detectors(DetectorPlace::Advance).filter(|(.., one)| one.begin_m > 30.0) {
        let mut expected = Vec::new();
        for second in 1..places.len() {
            for (car, &(lane, before_m)) in &places[second - 1] {
                let Some(&(now, after_m)) = places[second].get(car) else { continue };
                if lane == detector.lane
                    && edge(now) == edge(lane)
                    && before_m < detector.begin_m
                    && after_m >= detector.begin_m
                {
                    let time = second as f64 + (detector.begin_m - before_m) / (after_m - before_m);
                    expected.push((time, logged.has_green(site, detector.phase, second)));
                }
            }
        }
        expected.sort_by(|one, other| one.0.total_cmp(&other.0));
        // As `atspm` counts: the last of these events of the phase decides.
        let mut green = false;
        let mut found = Vec::new();
        for event in logged.events.iter().filter(|event| event.site == site) {
            match event.code {
                code::PHASE_BEGIN_GREEN if event.parameter == detector.phase => green = true,
                code::PHASE_BEGIN_YELLOW | code::PHASE_BEGIN_RED_CLEARANCE if event.parameter == detector.phase => {
                    green = false;
                }
                code::DETECTOR_ON if event.parameter == id => found.push((event.tenths, green)),
                _ => {}
            }
        }
        let of = |times: &[(f64, bool)]| -> Vec<(u64, bool)> {
            times.iter().map(|&(time, green)| ((10.0 * time + 1e-6) as u64, green)).collect()
        };
        let times = |crossings: &[(u64, bool)]| crossings.iter().map(|(tenths, _)| *tenths).collect::<Vec<_>>();
        let expected = of(&expected);
        assert_eq!(times(&found), times(&expected), "detector {id} of {}", logged.sites[site].light);
        differ += found.iter().zip(&expected).filter(|(found, expected)| found.1 != expected.1).count();
        arrivals += found.len();
        on_green += found.iter().filter(|(_, green)| *green).count();
    }
    assert!(arrivals > 500 && on_green > 100 && on_green < arrivals, "{on_green} of {arrivals}");
    assert_eq!(differ, 0, "of {arrivals} arrivals");
}

#[test]
fn a_detector_at_a_stop_line_is_on_whenever_the_front_of_a_car_is_over_it() {
    let logged = logged();
    let places = logged.places();
    let mut seconds_on = 0;
    for (site, id, detector) in logged.detectors(DetectorPlace::StopBar) {
        let of_detector = logged.events.iter().filter(|event| event.site == site && event.parameter == id);
        let changes: Vec<(u64, bool)> = of_detector
            .filter(|event| [code::DETECTOR_ON, code::DETECTOR_OFF].contains(&event.code))
            .map(|event| (event.tenths, event.code == code::DETECTOR_ON))
            .collect();
        assert!(changes.iter().enumerate().all(|(number, (_, on))| *on == (number % 2 == 0)), "on and off in turn");
        // The end of the episode turns all off.
        for (second, cars) in places.iter().enumerate().take(places.len() - 1) {
            let mut cars = cars.values();
            if cars.any(|&(lane, at_m)| lane == detector.lane && at_m >= detector.begin_m) {
                let now = 10 * (second as u64 + 1);
                let last = changes.iter().rev().find(|(tenths, _)| *tenths <= now);
                let is_on = last.is_some_and(|(_, on)| *on);
                assert!(is_on, "second {second}, detector {id} of {}", logged.sites[site].light);
                seconds_on += 1;
            }
        }
    }
    assert!(seconds_on > 1000, "{seconds_on}");
}

#[test]
fn every_lane_at_a_stop_line_has_one_phase_and_its_greens_follow_each_other() {
    let Logged { sites, events, .. } = logged();
    assert_eq!(sites.len(), 20);
    for (number, site) in sites.iter().enumerate() {
        let vehicles = site.phases.iter().filter(|phase| phase.kind == PhaseKind::Vehicles);
        let lanes: Vec<&String> = vehicles.flat_map(|phase| &phase.lanes).collect();
        let mut unique = lanes.clone();
        unique.sort();
        unique.dedup();
        assert_eq!(unique.len(), lanes.len());
        let numbered = site.phases.iter().zip(1..);
        for (_, id) in numbered.filter(|(phase, _)| phase.kind == PhaseKind::Vehicles) {
            let of_phase =
                events.iter().filter(|event| event.site == number && event.parameter == id && event.code < 81);
            let codes: Vec<u16> = of_phase.map(|event| event.code).collect();
            // A light that shows no red between two greens of a phase clears nothing.
            let known = [[1, 7], [7, 8], [8, 9], [9, 1], [9, 10], [10, 11], [11, 1]];
            assert!(codes.windows(2).all(|pair| known.iter().any(|known| known == pair)), "{codes:?}");
            assert!(codes.len() > 5, "{codes:?}");
        }
    }
}

#[test]
fn the_loops_change_nothing_in_the_episode() {
    let plain = played(&town());
    let with_loops = &logged().report;
    assert_eq!(plain.returns, with_loops.returns);
    assert_eq!(plain.measures, with_loops.measures);
}

fn baseline(folder: &Path, others: &[&str]) -> assert_cmd::assert::Assert {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/arterial/arterial.sumocfg");
    let mut command: Command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    let who: &[&str] = if others.contains(&"--compare") { &[] } else { &["--controller", "program"] };
    let settings = ["--set", "traffic.end_s=120", "--episodes", "2"];
    command.current_dir(folder).arg("baseline").arg(scenario).args(settings).args(who).args(others).assert()
}

#[test]
fn the_log_has_a_day_for_each_episode_and_two_tables_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    baseline(folder.path(), &["--events", "street.csv"]).success();
    let log = read("street.csv");
    assert!(log.starts_with("TimeStamp,DeviceId,EventId,Parameter\n2024-01-01 00:00:00.0,"), "{}", &log[..80]);
    assert!(log.contains("\n2024-01-02 00:00:00.0,") && !log.contains("2024-01-03"));
    let detectors = read("street_detectors.csv");
    assert!(detectors.starts_with("DeviceId,Phase,Parameter,Function,"));
    assert!(detectors.contains(",Presence,") && detectors.contains(",Advance,"));
    assert!(read("street_phases.csv").starts_with("DeviceId,Phase,Kind,Greens,States,Edge,Street,Movements,"));
    let again = baseline(folder.path(), &["--events", "street.csv"]).failure().code(2);
    let message = String::from_utf8_lossy(&again.get_output().stderr).into_owned();
    assert!(message.contains("street.csv: exists already"), "{message}");
    baseline(folder.path(), &["--events", "street.csv", "--force"]).success();
    assert_eq!(read("street.csv"), log, "the same episodes");
    let wrong = baseline(folder.path(), &["--events", "street.txt"]).failure().code(2);
    let message = String::from_utf8_lossy(&wrong.get_output().stderr).into_owned();
    assert!(message.contains("--events street.txt: must name a file that ends in .csv"), "{message}");
    let several =
        baseline(folder.path(), &["--events", "several.csv", "--compare", "program,max-pressure"]).failure().code(2);
    let message = String::from_utf8_lossy(&several.get_output().stderr).into_owned();
    assert!(message.contains("a log is of one controller; use --controller NAME instead of --compare"), "{message}");
}
