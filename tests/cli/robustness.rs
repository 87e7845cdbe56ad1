//! `--demand` and `--closed` as users see them.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;

const TOWN: &str = "sumo_nets/town/town.sumocfg";
/// Five minutes of the town.
const SHORT: [&str; 4] = ["--begin", "0", "--end", "300"];

fn program(args: &[&str]) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.args(args).current_dir(Path::new(env!("CARGO_MANIFEST_DIR")));
    command
}

fn baseline(args: &[&str]) -> Value {
    let args = [&["baseline", TOWN, "--json"], &SHORT[..], args].concat();
    let output = program(&args).assert().success().get_output().clone();
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refusal(args: &[&str]) -> String {
    let output = program(args).assert().code(2).get_output().clone();
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn all_players_drive_every_variant_and_the_unchanged_one_is_the_scenario_itself() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("csv");
    let played = ["--compare", "program,max-pressure", "--episodes", "2", "--seed", "3"];
    let variants = ["--demand", "0.5,1", "--closed", "b2_b3", "--csv", csv.to_str().unwrap()];
    let told = baseline(&[&played[..], &variants].concat());
    let told = told["variants"].as_array().unwrap();
    let names: Vec<(f64, usize)> = told
        .iter()
        .map(|variant| (variant["demand"].as_f64().unwrap(), variant["closed"].as_array().unwrap().len()))
        .collect();
    assert_eq!(names, [(0.5, 0), (1.0, 0), (0.5, 1), (1.0, 1)]);
    let mut alone = baseline(&played);
    // Figures of each light are measured on the scenario alone.
    for player in alone["controllers"].as_array_mut().unwrap() {
        ["lights", "lost_time"].iter().for_each(|key| drop(player.as_object_mut().unwrap().remove(*key)));
    }
    for key in ["controllers", "differences"] {
        assert_eq!(told[1][key], alone[key], "{key}");
    }
    let cars = |variant: &Value| variant["controllers"][0]["departed"].as_f64().unwrap();
    // Half of the demand, but for cars that still wait to enter.
    assert!((0.4..0.6).contains(&(cars(&told[0]) / cars(&told[1]))), "{} {}", cars(&told[0]), cars(&told[1]));
    assert!(told[3]["rerouted"].as_f64().unwrap() > 0.0, "{}", told[3]["rerouted"]);
    assert!(told[1].get("rerouted").is_none());
    assert_ne!(told[3]["controllers"][0]["delay_s"], told[1]["controllers"][0]["delay_s"]);
    let episodes = fs::read_to_string(csv.join("episodes.csv")).unwrap();
    let lines: Vec<&str> = episodes.lines().collect();
    assert!(lines[0].starts_with("controller,demand,closed,episode,return,"), "{}", lines[0]);
    assert_eq!(lines.len(), 1 + 4 * 2 * 2);
    assert!(lines[5].starts_with("program,1,,0,") && lines[13].starts_with("program,1,b2_b3,0,"), "{episodes}");
}

#[test]
fn a_table_has_a_line_for_each_player_and_a_column_for_each_variant() {
    let args = ["baseline", TOWN, "--compare", "program,max-pressure", "--episodes", "2", "--demand", "0.5,1"];
    let output = program(&[&args[..], &SHORT].concat()).assert().success().get_output().clone();
    let text = String::from_utf8(output.stdout).unwrap();
    for part in ["delay_s\n", "demand 0.5", "demand 1\n", "delay_s: difference from program (paired by episode)\n"] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
}

#[test]
fn typing_errors_are_refused_before_anything_is_tried() {
    for (args, parts) in [
        (
            &["baseline", TOWN, "--controller", "program", "--closed", "b2_b33"][..],
            &["no edge `b2_b33`", "`b2_b3`"][..],
        ),
        (&["baseline", TOWN, "--controller", "program", "--demand", "0"], &["must be from 0.01 to 100"]),
        (&["baseline", TOWN, "--controller", "max-presure"], &["unknown (did you mean `max-pressure`?)"]),
        (
            &["baseline", TOWN, "--controller", "program", "--set", "traffic.mingreen_s=9"],
            &["did you mean `min_green_s`?"],
        ),
        (
            &["baseline", "configs/traffic_4.toml", "--controller", "actuated", "--demand", "0.8"],
            &["scenarios of SUMO", "nets grid --inflow"],
        ),
        (
            &["baseline", TOWN, "--controller", "program", "--demand", "0.8", "--plot", "x"],
            &["--plot: is of one scenario"],
        ),
    ] {
        let said = refusal(args);
        assert!(parts.iter().all(|part| said.contains(part)), "{args:?}: {said}");
    }
}

#[test]
fn a_map_of_openstreetmap_is_answered_with_the_command_that_makes_a_net() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("city.osm.xml");
    fs::write(&map, "<osm version=\"0.6\"/>").unwrap();
    let map = map.to_str().unwrap();
    for args in [&["train", map][..], &["baseline", map, "--controller", "program"], &["nets", "inspect", map]] {
        let said = refusal(args);
        assert!(said.contains("netconvert --osm-files") && said.contains("city.net.xml"), "{args:?}: {said}");
    }
}
