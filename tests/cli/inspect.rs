//! `nets inspect` as users see it.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;

fn inspect(args: &[&str]) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.args(["nets", "inspect"]).args(args).current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}

fn net(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").join(name).to_str().unwrap().to_owned()
}

fn answer(args: &[&str]) -> String {
    let output = inspect(args).assert().success().get_output().clone();
    String::from_utf8(output.stdout).unwrap()
}

fn refusal(args: &[&str]) -> String {
    let output = inspect(args).assert().code(2).get_output().clone();
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn a_scenario_and_its_net_are_told_alike_and_for_people() {
    let told = answer(&[&net("grid_2x2.sumocfg"), "--all"]);
    let of_the_net = answer(&[&net("grid_2x2.net.xml"), "--all"]);
    let (before, note) = told.split_once("not simulated: a car that cannot enter as fast as it should").unwrap();
    let told = before.to_owned() + note.split_once("it waits\n").unwrap().1;
    // Only a scenario says on which roads cars depart. So what is told of influence differs, at the end of each light.
    let others = |text: &str| -> Vec<String> {
        let lights = text.split("\nlight ").map(|light| light.split(" influence sources:\n").next().unwrap());
        let without_count = |part: &str| part.rsplit_once('\n').map_or(String::new(), |(lines, _)| lines.to_owned());
        let lights = lights.map(without_count);
        lights
            .map(|part| part.lines().filter(|line| !line.contains("predictor")).collect::<Vec<_>>().join("\n"))
            .collect()
    };
    assert_eq!(others(&told).len(), 5);
    assert_eq!(others(&told), others(&of_the_net));
    assert!(of_the_net.contains("sees 73 columns (the d-set) and predicts 16 sources\n"), "{of_the_net}");
    for part in [
        "grid_2x2.net.xml: 4 lights; 4 learn, 0 keep their program\n",
        "all agents are of one kind: 44 columns (0 % of them padding), 2 actions\n",
        "learns, agent 3\n",
        "  2 greens, and what is shown before another one:\n    0  GrGr  at least 5 s\n       yryr 3 s  before 1\n    1  rGrG  at least 5 s\n",
        "  4 approach lanes, 4 of them at the stop line:\n",
        "an influence predictor sees 81 columns (the d-set) and predicts 26 sources\n",
        "\n    10-14  arrival departures on s0_r0c0[0] to [4]\n",
        "\n  81 d-set columns:\n    0-3    part of the episode[0] to [3]\n",
        "\n    40-41  green[0] to [1]\n    42     between greens\n    43     time since change\n",
    ] {
        assert!(told.contains(part), "{part}\n{told}");
    }
}

#[test]
fn every_light_has_a_line_and_one_can_be_shown_in_full() {
    let town = "sumo_nets/town/town.sumocfg".to_owned();
    let told = answer(&[&town]);
    assert!(told.lines().count() < 40 && told.lines().all(|line| line.chars().count() <= 80), "{told}");
    let rows: Vec<Vec<&str>> = told.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(rows[0][..5], ["light", "program", "greens", "columns", "approaches"]);
    assert_eq!(rows[1], ["b2", "static", "2", "64", "8", "learns"]);
    assert_eq!(rows.iter().filter(|row| row.last() == Some(&"learns")).count(), 20);
    assert!(told.contains("town.net.xml: 20 lights; 20 learn, 0 keep their program\n"), "{told}");

    let [one, all] = [&["--light", "b2"][..], &["--all"]].map(|more| answer(&[&[&*town], more].concat()));
    assert!(one.starts_with("light b2: learns, agent 0\n") && all.contains(&one), "{one}");
    assert!(all.matches("\nlight ").count() == 20 && !one.contains("\nlight "), "{one}");
    let unknown = refusal(&[&town, "--light", "B2"]);
    assert!(
        unknown.contains("no light `B2` is here (did you mean `b2` or ") && unknown.contains("without the option"),
        "{unknown}"
    );
    let unknown = refusal(&[&town, "--light", "-38#1"]);
    assert!(unknown.contains("no light `-38#1` is here"), "names of real maps may begin so: {unknown}");
    inspect(&[&town, "--light", "b2", "--all"]).assert().code(2);
}

#[test]
fn one_of_our_grids_is_not_taken_for_its_config_without_a_word() {
    let said = |name: &str, more: &[&str]| {
        let output = inspect(&[&[&*net(name)], more].concat()).assert().success().get_output().clone();
        String::from_utf8(output.stderr).unwrap().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    for (name, more) in [("grid_2x2.sumocfg", &[][..]), ("grid_2x2.net.xml", &["--json"])] {
        let told = said(name, more);
        assert!(told.starts_with("note: this is one of the paper's grids") && told.contains(" 40 columns"), "{told}");
    }
    assert_eq!(said("town/town.sumocfg", &[]), "");
}

#[test]
fn json_has_all_that_the_text_has() {
    let told: Value = serde_json::from_str(&answer(&[&net("grid_2x2.net.xml"), "--json"])).unwrap();
    assert_eq!(told["kind"], serde_json::json!({ "columns": 44, "actions": 2, "padded_share": 0.0 }));
    let lights = told["learning"].as_array().unwrap();
    assert_eq!((lights.len(), told["keeping"].as_array().unwrap().len()), (4, 0));
    for light in lights {
        assert_eq!(light["columns"].as_array().unwrap().len(), 44);
        for (names, all) in [("sources", "sources"), ("d_set_columns", "d_set_columns")] {
            let names = light[names].as_array().unwrap().len() as u64;
            assert!(names > 0 && names <= told["influence"][all].as_u64().unwrap());
        }
        let sizes =
            ["approaches", "links", "exits", "greens", "changes"].map(|key| light[key].as_array().unwrap().len());
        assert_eq!(sizes, [4, 4, 4, 2, 2]);
        assert_eq!(light["changes"][0]["states"], serde_json::json!([{ "state": "yryr", "seconds": 3 }]));
    }
}

#[test]
fn a_file_says_otherwise_and_the_map_is_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let [agents, map] = ["agents.toml", "map"].map(|name| dir.path().join(name));
    let lights: Value = serde_json::from_str(&answer(&[&net("grid_2x2.net.xml"), "--json"])).unwrap();
    let first = lights["learning"][0]["light"].as_str().unwrap();
    fs::write(&agents, format!("keep = ['{first}']")).unwrap();
    let [agents, map] = [&agents, &map].map(|path| path.to_str().unwrap());
    let told = answer(&[&net("grid_2x2.net.xml"), "--agents", agents, "--plot", map]);
    let row = told.lines().find(|line| line.trim_start().starts_with(first)).unwrap();
    assert!(row.ends_with("-           keeps its program: agents.toml"), "{told}");
    assert!(
        told.contains(&format!("\nlight `{first}` keeps its program: agents.toml says so; way out: let it")),
        "{told}"
    );
    let in_full = answer(&[&net("grid_2x2.net.xml"), "--agents", agents, "--light", first]);
    let way_out = "  way out: let it learn in agents.toml\n";
    assert_eq!(in_full, format!("light {first}: keeps its program\n  why: agents.toml says so\n{way_out}"));
    let svg = fs::read_to_string(Path::new(map).join("regions.svg")).unwrap();
    assert!(svg.contains("3 learn (numbers), 1 keep their program (crosses)"), "{svg}");
    assert!(refusal(&[&net("grid_2x2.net.xml"), "--plot", map]).contains("map: exists already"));
}

#[test]
fn what_cannot_be_inspected_is_refused_with_its_place() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = dir.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let missing = dir.path().join("none.net.xml").display().to_string();
    assert!(refusal(&[&missing]).starts_with(&format!("error: {missing}: could not be read\n")));
    let no_net = write("a.sumocfg", "<configuration><input/></configuration>");
    assert!(refusal(&[&no_net]).contains("a.sumocfg: names no net; add <net-file"));
    let routes = write("b.net.xml", "<routes/>");
    assert!(refusal(&[&routes]).contains("b.net.xml: is not a SUMO network: its root is <routes>, not <net>"));
    let dark = write("c.net.xml", "<net/>");
    assert!(refusal(&[&dark]).contains("c.net.xml: has no traffic light: no element <tlLogic>"));
    let config = refusal(&["configs/town.toml"]);
    assert!(config.contains("configs/town.toml: is a config of this program; inspect the .sumocfg"), "{config}");
    let wrong = write("agents.toml", "[light.x]\nyelow_s = 3");
    let told = refusal(&[&net("grid_2x2.net.xml"), "--agents", &wrong]);
    assert!(told.contains("agents.toml: ") && told.contains("unknown field `yelow_s`"), "{told}");
}
