//! Scenarios on the global simulator: lights, delays and a short training, as users see them.

use std::fs;
use std::io::{Write, stderr};
use std::path::{Path, PathBuf};
use std::process::Command as Program;

use assert_cmd::Command;
use dials_core::base::{RandomPurpose, Seed};
use dials_core::domain::{Action, Domain};
use dials_learn::evaluation::episode_seed;
use dials_traffic::Traffic;
use dials_traffic::config::ScenarioConfig;
use dials_traffic::config::sumocfg::Sumocfg;
use rand::Rng;
use serde_json::Value;

use super::room::{BUSES, CARS, Room, SUMOCFG, table};
use crate::plain_sumo;

const SHIPPED: [&str; 3] = ["arterial", "grid_4x4_turns", "town"];
const REAL: [&str; 5] = ["cologne1", "cologne3", "ingolstadt1", "ingolstadt7", "grid4x4"];

pub(super) fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("sumo_nets/{name}/{name}.sumocfg"))
}

/// Returns the shipped scenarios, and the real ones in the folder that `DIALS_NETWORKS` names.
fn all() -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = SHIPPED.iter().map(|name| shipped(name)).collect();
    match std::env::var_os("DIALS_NETWORKS").map(PathBuf::from) {
        Some(folder) => {
            found.extend(REAL.iter().map(|name| folder.join(name).join(name).with_extension("sumocfg")));
        }
        None => {
            // Not `eprintln`, which is hidden when a test passes.
            let line = "not tested: random greens on real networks: DIALS_NETWORKS names no folder with them\n";
            stderr().write_all(line.as_bytes()).unwrap();
        }
    }
    found
}

/// Returns the first seconds of a scenario.
pub(super) fn opened(scenario: &Path, seconds: u64) -> Traffic {
    let begin = Sumocfg::read(scenario).unwrap().begin_s;
    let window = [begin, begin + seconds].map(Some);
    let config = ScenarioConfig { begin_s: window[0], end_s: window[1], ..ScenarioConfig::new(scenario) };
    Traffic::open_scenario(&config).unwrap()
}

pub(super) fn dials_traffic() -> Command {
    assert_cmd::cargo::cargo_bin_cmd!("dials-traffic")
}

pub(super) fn json(output: &[u8]) -> Value {
    serde_json::from_slice(output).unwrap()
}

#[test]
fn random_greens_never_make_a_car_stop_in_an_emergency_and_masks_are_kept() {
    for scenario in all() {
        let name = scenario.display();
        let traffic = opened(&scenario, 1500);
        let mut gs = traffic.global_simulator().unwrap();
        gs.reset(Seed::new(1)).unwrap();
        let mut dice = Seed::new(2).fork(RandomPurpose::Acting).dice();
        let mut allowed: Vec<Vec<bool>> = vec![Vec::new(); traffic.agents()];
        let mut changed = 0;
        for step in 0..300 {
            let actions: Vec<Action> = traffic
                .plans()
                .iter()
                .zip(&allowed)
                .map(|(plan, allowed)| {
                    loop {
                        let action = dice.random_range(0..plan.phases.actions());
                        if step == 0 || allowed[action] {
                            break Action::try_from(action).unwrap();
                        }
                    }
                })
                .collect();
            let percept = &gs.step(&actions).unwrap().percept;
            for (row, (allowed, plan)) in allowed.iter_mut().zip(traffic.plans()).enumerate() {
                *allowed = percept.masks.row(row).to_vec();
                assert!(allowed.iter().any(|&allowed| allowed), "{name}: {} may do nothing", plan.light);
                assert!(!allowed[plan.phases.actions()..].contains(&true), "{name}: a padded action is allowed");
                changed += usize::from(allowed[..plan.phases.actions()].iter().all(|&allowed| allowed));
            }
        }
        assert!(changed > 0, "{name}: no light could ever choose");
        let measures = gs.measures().unwrap().system;
        let figure = |wanted: &str| measures.iter().find(|(name, _)| name == wanted).unwrap().1;
        assert!(figure("departed") > 100.0, "{name}");
        assert_eq!((figure("emergency_stops"), figure("collisions"), figure("teleports")), (0.0, 0.0, 0.0), "{name}");
    }
}

#[test]
fn cars_that_end_their_trip_on_an_approach_or_are_teleported_have_not_passed() {
    let room = Room::new();
    room.change(SUMOCFG, "<time-to-teleport value=\"300\"/>", "<time-to-teleport value=\"30\"/>");
    // Rows of lights are counted from the south. Cars from the west have red at r0c0 for ever.
    let cars = r#"<routes>
        <vehicle id="0" depart="100"><route edges="s0_r0c0 r0c0_r1c0 r1c0_n0"/></vehicle>
        <vehicle id="3" depart="100"><route edges="w0_r0c0 r0c0_r0c1"/></vehicle>
        <vehicle id="1" depart="110"><route edges="s0_r0c0 r0c0_r1c0"/></vehicle>
        <vehicle id="2" depart="120"><route edges="s0_r0c0"/></vehicle>
    </routes>"#;
    fs::write(room.path(CARS), cars).unwrap();
    fs::write(room.path(BUSES), "<routes/>").unwrap();
    let traffic = Traffic::open_scenario(&table(room.config(&[]).unwrap())).unwrap();
    let mut gs = traffic.global_simulator().unwrap();
    gs.measure_in_full().unwrap();
    gs.reset(Seed::new(1)).unwrap();
    for _ in 0..40 {
        gs.step(&[0; 4]).unwrap();
    }
    let measures = gs.measures().unwrap();
    let (_, passed) = measures.per_agent.iter().find(|(name, _)| name == "passed").unwrap();
    let of = |light: &str| passed[traffic.plans().iter().position(|plan| plan.light == light).unwrap()];
    let figure = |wanted: &str| measures.system.iter().find(|(name, _)| name == wanted).unwrap().1;
    assert_eq!((figure("arrived"), figure("teleports")), (4.0, 1.0), "{measures:?}");
    assert_eq!((of("r0c0"), of("r1c0")), (2.0, 1.0), "{measures:?}");
}

/// Computes the delay from SUMO's own output, by other code than the product's.
#[test]
fn the_delay_of_own_programs_is_that_of_plain_sumo() {
    let output = dials_traffic()
        .args(["baseline", shipped("arterial").to_str().unwrap(), "--controller", "program", "--episodes", "1"])
        .arg("--json")
        .assert()
        .success();
    let found = json(&output.get_output().stdout)["delay_s"].as_f64().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let trips = dir.path().join("trips.xml");
    let seed = episode_seed(Seed::new(0), 0).for_sumo();
    let status = Program::new(plain_sumo())
        .args(["-c", shipped("arterial").to_str().unwrap(), "--tripinfo-output", trips.to_str().unwrap()])
        .args(["--tripinfo-output.write-unfinished", "true", "--tripinfo-output.write-undeparted", "true"])
        .args(["--no-step-log", "true", "--precision", "6", "--seed", &seed.to_string()])
        .status()
        .unwrap();
    assert!(status.success());
    let text = fs::read_to_string(trips).unwrap();
    let number = |line: &str, name: &str| -> f64 {
        line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
    };
    let lost: Vec<f64> = text
        .lines()
        .filter(|line| line.contains("<tripinfo "))
        .map(|line| number(line, "timeLoss") + number(line, "departDelay"))
        .collect();
    let expected = lost.iter().sum::<f64>() / lost.len() as f64;
    assert!(lost.len() > 1000 && (found - expected).abs() < 1e-3, "{found} s, but {expected} s by plain SUMO");
}

#[test]
fn a_scenario_trains_on_the_global_simulator_resumes_and_needs_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run");
    let train = |out: &Path, more: &[&str]| {
        dials_traffic()
            .args(["train", shipped("town").to_str().unwrap(), "--workers", "1", "--out", out.to_str().unwrap()])
            .args(["--simulator", "gs"])
            .args(["--set", "traffic.end_s=300", "--set", "total_steps=240", "--set", "ppo.rollout_steps=60"])
            .args(["--set", "ppo.memory=60", "--set", "ppo.minibatch=20", "--set", "evaluation.every_steps=120"])
            .args(["--set", "evaluation.episodes=1", "--set", "evaluation.final_episodes=2"])
            .args(["--set", "policy.hidden=[16]"])
            .args(more)
            .assert()
            .success();
    };
    train(&run, &[]);
    let stopped = dir.path().join("stopped");
    train(&stopped, &["--steps", "120"]);
    dials_traffic().args(["train", "--resume", run.to_str().unwrap()]).assert().success();
    let returns = fs::read_to_string(run.join("returns.csv")).unwrap();
    let begun = fs::read_to_string(stopped.join("returns.csv")).unwrap();
    assert!(returns.lines().count() == 1 + 3 * 21, "three evaluations of 20 agents: {returns}");
    let first = |text: &str| text.lines().take(1 + 21).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(first(&returns), first(&begun));
    // The run directory holds its scenario.
    let evaluated = |dir: &Path| {
        let output = dials_traffic().args(["evaluate", dir.to_str().unwrap(), "--json"]).assert().success();
        json(&output.get_output().stdout)["return"].as_f64().unwrap()
    };
    let moved = dir.path().join("elsewhere");
    let before = evaluated(&run);
    fs::rename(&run, &moved).unwrap();
    assert_eq!(evaluated(&moved), before);
}
