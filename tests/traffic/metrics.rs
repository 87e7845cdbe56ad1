//! The traffic metrics against SUMO's own output. The program `sumo` plays the same episodes with the same lights, and
//! this test computes the metrics again from its output for every car at every second.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::plain_sumo;
use dials_core::base::Seed;
use dials_core::domain::{Baseline, Domain};
use dials_learn::evaluation::{EpisodeReport, play};
use dials_traffic::Traffic;
use dials_traffic::config::{EntryRule, TrafficConfig};
use dials_traffic::paper_grid::grid::Grid;

const STEPS: usize = 300;

fn nets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets")
}

/// Returns the 2x2 grid with this probability of a car per step and edge.
fn traffic(dir: &Path, inflow: &str) -> Traffic {
    let files = fs::read_dir(nets()).unwrap().map(|entry| entry.unwrap().path());
    for file in files.filter(|path| path.is_file()) {
        let name = file.file_name().unwrap().to_str().unwrap().to_owned();
        let text = fs::read_to_string(&file).unwrap();
        fs::write(dir.join(name), text.replace("probability=\"0.1\"", &format!("probability=\"{inflow}\""))).unwrap();
    }
    let config = TrafficConfig {
        horizon: STEPS,
        entry: EntryRule::Max,
        ..TrafficConfig::new(dir.join("grid_2x2"), dir.join("local"))
    };
    Traffic::open(&config).unwrap()
}

fn measured(domain: &Traffic, controller: &str, episode: Seed) -> EpisodeReport {
    let Baseline { mut simulator, mut controller } = domain.baseline(controller).unwrap();
    simulator.measure_in_full().unwrap();
    play(&mut *simulator, &mut *controller, episode).unwrap()
}

/// Returns the lights of the 2x2 grid as programs of SUMO's, which show `shown`, second by second.
fn program(shown: impl Fn(usize) -> &'static str) -> String {
    let phases: String = (0..STEPS).map(|t| format!("<phase duration=\"1\" state=\"{}\"/>", shown(t))).collect();
    let grid = Grid::new(2, 2).unwrap();
    let lights = grid.agents().into_iter().map(|agent| {
        format!(
            "<tlLogic id=\"{}\" type=\"static\" programID=\"shown\" offset=\"0\">{phases}</tlLogic>",
            grid.light(agent)
        )
    });
    format!("<additional>{}</additional>", lights.collect::<String>())
}

/// The output of the program `sumo` for an episode.
struct Output {
    fcd: String,
    trips: String,
}

fn run_sumo(dir: &Path, lights: &Path, episode: Seed) -> Output {
    let [fcd, trips] = ["fcd.xml", "trips.xml"].map(|name| dir.join(name));
    let status = Command::new(plain_sumo())
        .args(["--no-step-log", "true", "--no-warnings", "true", "--xml-validation", "never", "--precision", "9"])
        .args(["--time-to-teleport", "-1", "--step-length", "1", "--end", &STEPS.to_string()])
        .args(["--seed", &episode.for_sumo().to_string(), "--tripinfo-output.write-unfinished", "true"])
        .args(["--tripinfo-output.write-undeparted", "true"])
        .arg("-n")
        .arg(dir.join("grid_2x2.net.xml"))
        .arg("-r")
        .arg(dir.join("grid_2x2.rou.xml"))
        .arg("-a")
        .arg(lights)
        .arg("--fcd-output")
        .arg(&fcd)
        .arg("--tripinfo-output")
        .arg(&trips)
        .status()
        .unwrap();
    assert!(status.success());
    Output { fcd: fs::read_to_string(fcd).unwrap(), trips: fs::read_to_string(trips).unwrap() }
}

fn attribute<'a>(line: &'a str, name: &str) -> &'a str {
    let (_, rest) = line.split_once(&format!(" {name}=\"")).unwrap_or_else(|| panic!("no {name} in {line}"));
    rest.split('"').next().unwrap()
}

fn number(line: &str, name: &str) -> f64 {
    attribute(line, name).parse().unwrap()
}

/// Returns the metrics, computed from the cars of every second and their delays before departure.
fn recomputed(output: &Output) -> (BTreeMap<&'static str, f64>, [u64; 4]) {
    let incoming: Vec<BTreeSet<String>> = {
        let grid = Grid::new(2, 2).unwrap();
        let lanes = |agent| grid.incoming_edges(agent).into_iter().map(|edge| format!("{edge}_0")).collect();
        grid.agents().into_iter().map(lanes).collect()
    };
    let intersection = |lane: &str| incoming.iter().position(|lanes| lanes.contains(lane));
    // For every car: seconds on the road, seconds after the first, seconds lost and waited in them, and its lane.
    let mut cars: BTreeMap<String, (f64, f64, f64, String)> = BTreeMap::new();
    let (mut on_edges, mut speed_sum, mut halting) = (0.0, 0.0, 0.0);
    let mut passed = [0; 4];
    let mut last_second = BTreeSet::new();
    for line in output.fcd.lines() {
        if line.contains("<timestep ") {
            last_second.clear();
        }
        if !line.contains("<vehicle ") {
            continue;
        }
        let (id, lane, speed) = (attribute(line, "id"), attribute(line, "lane"), number(line, "speed"));
        last_second.insert(id.to_owned());
        if intersection(lane).is_some() {
            on_edges += 1.0;
            speed_sum += speed;
            halting += f64::from(speed < 0.1);
        }
        match cars.get_mut(id) {
            None => drop(cars.insert(id.to_owned(), (1.0, 0.0, 0.0, lane.to_owned()))),
            Some((seconds, lost, waited, before)) => {
                *seconds += 1.0;
                *lost += 1.0 - speed / 10.0;
                *waited += f64::from(speed <= 0.1);
                if let Some(agent) = intersection(before)
                    && before != lane
                {
                    passed[agent] += 1;
                }
                lane.clone_into(before);
            }
        }
    }
    let trips: Vec<&str> = output.trips.lines().filter(|line| line.contains("<tripinfo ")).collect();
    let depart_delay: f64 = trips.iter().map(|line| number(line, "departDelay")).sum();
    let entered = cars.len() as f64;
    let arrived = entered - last_second.len() as f64;
    let lost: f64 = cars.values().map(|car| car.1).sum();
    let figures = [
        ("mean_speed_mps", speed_sum / on_edges),
        ("travel_time_s", cars.values().map(|car| car.0).sum::<f64>() / entered),
        ("delay_s", (lost + depart_delay) / trips.len() as f64),
        ("waiting_time_s", cars.values().map(|car| car.2).sum::<f64>() / entered),
        ("queue_length", halting / (16 * STEPS) as f64),
        ("throughput_per_h", arrived * 12.0),
        ("departed", entered),
        ("arrived", arrived),
        ("backlog", trips.len() as f64 - entered),
    ];
    (figures.into_iter().collect(), passed)
}

fn assert_agreement(dir: &Path, controller: &str, lights: &Path, inflow: &str) {
    let domain = traffic(dir, inflow);
    let episode = Seed::new(11).for_episode(0);
    let report = measured(&domain, controller, episode);
    let (expected, passed) = recomputed(&run_sumo(dir, lights, episode));
    let system: BTreeMap<&str, f64> =
        report.measures.system.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    for (name, expected) in &expected {
        // SUMO counts a car's last step, in which it leaves at 9.9 to 10 m/s, but no second shows the car after it.
        // SUMO also rounds the time lost in a step to milliseconds.
        let tolerance = if *name == "delay_s" { 0.02 } else { 1e-6 };
        assert!((system[name] - expected).abs() < tolerance, "{controller}: {name} {} {expected}", system[name]);
    }
    let [passed_by_us] = ["passed"].map(|wanted| {
        let (_, values) = report.measures.per_agent.iter().find(|(name, _)| name == wanted).unwrap();
        values.iter().map(|&value| value as u64).collect::<Vec<_>>()
    });
    assert_eq!(passed_by_us, passed, "{controller}");
    let agents = |wanted: &str| -> f64 {
        let (_, values) = report.measures.per_agent.iter().find(|(name, _)| name == wanted).unwrap();
        values.iter().sum::<f64>() / 4.0
    };
    assert!((agents("queue_length") - system["queue_length"]).abs() < 1e-9);
    println!("{controller}: {system:?}");
}

#[test]
fn the_metrics_of_switching_every_13_steps_are_those_of_sumos_own_output() {
    let dir = tempfile::tempdir().unwrap();
    // The 13th action takes effect before second 12. From then on: 3 s of yellow and 10 s of green.
    let shown = program(|t| match (t + 1) % 26 {
        0..=2 if t > 3 => "ryry",
        13..=15 => "yryr",
        16..=25 => "rGrG",
        _ => "GrGr",
    });
    let lights = dir.path().join("lights.add.xml");
    fs::write(&lights, shown).unwrap();
    assert_agreement(dir.path(), "switch-every-13", &lights, "0.1");
}

/// Cars on a lane in a second: their names and speeds.
type Lane<'a> = Vec<(&'a str, f64)>;

/// Returns the cars of every second by their lanes.
fn seconds(fcd: &str) -> Vec<BTreeMap<&str, Lane<'_>>> {
    let mut seconds: Vec<BTreeMap<&str, Lane<'_>>> = Vec::new();
    for line in fcd.lines() {
        if line.contains("<timestep ") {
            seconds.push(BTreeMap::new());
        } else if line.contains("<vehicle ") {
            let lanes = seconds.last_mut().unwrap();
            lanes.entry(attribute(line, "lane")).or_default().push((attribute(line, "id"), number(line, "speed")));
        }
    }
    seconds
}

/// Returns what each light earns in an episode: `mean-speed`, `queue`, `lost-time`, `pressure`, `wait`,
/// `diff-waiting-time` and `exit-speed`.
fn earned(fcd: &str) -> Vec<[f64; 7]> {
    let grid = Grid::new(2, 2).unwrap();
    let of_agent = |agent| {
        let [approaches, exits] =
            [grid.incoming_edges(agent), grid.outgoing_edges(agent)].map(|edges| edges.map(|edge| format!("{edge}_0")));
        let mut sums = [0.0; 7];
        let mut waited: BTreeMap<&str, f64> = BTreeMap::new();
        let mut waited_before = 0.0;
        for lanes in seconds(fcd) {
            let on = |names: &[String; 4]| -> Lane<'_> {
                names.iter().flat_map(|lane| lanes.get(lane.as_str()).cloned().unwrap_or_default()).collect()
            };
            let (come, leave) = (on(&approaches), on(&exits));
            let stands = |speed: f64| f64::from(u8::from(speed < 0.1));
            let speeds: f64 = come.iter().map(|(_, speed)| speed / 10.0).sum();
            let cars = come.len() as f64;
            waited = come
                .iter()
                .map(|&(car, speed)| (car, waited.get(car).copied().unwrap_or(0.0) + stands(speed)))
                .collect();
            let waits: f64 = waited.values().sum();
            sums[0] += if come.is_empty() { 0.0 } else { speeds / cars };
            sums[1] -= come.iter().map(|&(_, speed)| stands(speed)).sum::<f64>() / 10.0;
            sums[2] -= (cars - speeds) / 10.0;
            sums[3] += (leave.len() as f64 - cars) / 10.0;
            sums[4] -= (waits / 100.0).min(10.0);
            sums[5] += (waited_before - waits) / 100.0;
            waited_before = waits;
            let left: f64 = leave.iter().map(|(_, speed)| speed / 10.0).sum();
            sums[6] += left / leave.len().max(1) as f64;
        }
        sums
    };
    grid.agents().into_iter().map(of_agent).collect()
}

#[test]
fn every_reward_of_a_grid_is_what_sumos_own_cars_say() {
    let dir = tempfile::tempdir().unwrap();
    let lights = dir.path().join("lights.add.xml");
    fs::write(&lights, program(|_| "GrGr")).unwrap();
    traffic(dir.path(), "0.1");
    let episode = Seed::new(13).for_episode(0);
    let earned = earned(&run_sumo(dir.path(), &lights, episode).fcd);
    let names = ["mean-speed", "queue", "lost-time", "pressure", "wait", "diff-waiting-time", "exit-speed"];
    let returns = |reward: &str| {
        let config = TrafficConfig {
            reward: serde_json::from_str(reward).unwrap(),
            ..TrafficConfig::new(dir.path().join("grid_2x2"), dir.path().join("local"))
        };
        measured(&Traffic::open(&config).unwrap(), "never", episode).returns
    };
    for (term, name) in names.iter().enumerate() {
        for (agent, (ours, earned)) in returns(&format!("\"{name}\"")).iter().zip(&earned).enumerate() {
            assert!(earned[term].abs() > 1.0, "{name}: the episode shows it");
            assert!((ours - earned[term]).abs() < 1e-3, "{name}, agent {agent}: {ours} {}", earned[term]);
        }
    }
    for (ours, earned) in returns("{\"queue\":0.5,\"wait\":-0.25}").iter().zip(&earned) {
        assert!((ours - (0.5 * earned[1] - 0.25 * earned[4])).abs() < 1e-3);
    }
}

#[test]
fn the_metrics_of_actuated_lights_and_of_a_long_backlog_are_those_of_sumos_own_output() {
    let dir = tempfile::tempdir().unwrap();
    // With this inflow, a hundred cars never enter.
    assert_agreement(dir.path(), "actuated", &dir.path().join("grid_2x2.actuated.add.xml"), "0.35");
}

#[test]
fn cars_that_never_enter_are_counted_in_the_delay() {
    let dir = tempfile::tempdir().unwrap();
    let lights = dir.path().join("lights.add.xml");
    fs::write(&lights, program(|_| "GrGr")).unwrap();
    assert_agreement(dir.path(), "never", &lights, "0.1");
}

#[test]
fn measuring_in_full_changes_nothing_but_what_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let domain = traffic(dir.path(), "0.1");
    let episode = Seed::new(12).for_episode(0);
    let plain = {
        let Baseline { mut simulator, mut controller } = domain.baseline("gap-out").unwrap();
        play(&mut *simulator, &mut *controller, episode).unwrap()
    };
    let full = measured(&domain, "gap-out", episode);
    assert_eq!(plain.returns, full.returns);
    for (name, value) in &plain.measures.system {
        assert!(full.measures.system.contains(&(name.clone(), *value)), "{name}");
    }
    assert!(full.measures.system.len() > plain.measures.system.len());
}

#[test]
fn measures_in_full_can_be_asked_for_again_but_end_the_episode() {
    let dir = tempfile::tempdir().unwrap();
    let domain = traffic(dir.path(), "0.1");
    let mut gs = domain.global_simulator().unwrap();
    gs.measure_in_full().unwrap();
    let play = |gs: &mut dyn dials_core::domain::GlobalSimulator| {
        gs.reset(Seed::new(3)).unwrap();
        (0..100).for_each(|_| drop(gs.step(&[0; 4]).unwrap().clone()));
        gs.measures().unwrap()
    };
    let first = play(&mut *gs);
    assert_eq!(gs.measures().unwrap(), first);
    let error = gs.step(&[0; 4]).unwrap_err().to_string();
    assert_eq!(error, "the episode ended with its measures");
    assert_eq!(play(&mut *gs), first, "the next episode is equal");
}
