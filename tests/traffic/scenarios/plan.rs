//! Plans that plain SUMO plays: it has the delay that was printed, and its lights are safe.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command as Program;

use serde_json::Value;

use super::play::{dials_traffic, json, shipped};
use super::room::{BUSES, CARS, MORE, Room, SUMOCFG};
use crate::plain_sumo;

fn plan(scenario: &Path, out: &Path, args: &[&str]) -> Value {
    let mut command = dials_traffic();
    command.args(["plan", scenario.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"]).args(args);
    json(&command.assert().success().get_output().stdout)
}

/// Plays the first episode by the command that was printed, in a folder. Returns the mean delay by other code than the
/// product's.
fn plain_delay_s(found: &Value, folder: &Path) -> f64 {
    let command = found["check_command"].as_str().unwrap();
    let command = command.strip_prefix("sumo ").unwrap();
    let typed = format!("'{}' {command} --no-step-log --no-warnings", plain_sumo().display());
    assert!(Program::new("sh").args(["-c", &typed]).current_dir(folder).status().unwrap().success(), "{typed}");
    let trips = fs::read_to_string(folder.join("trips.xml")).unwrap();
    let number = |line: &str, name: &str| -> f64 {
        line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
    };
    let lines = trips.lines().filter(|line| line.contains("<tripinfo "));
    let lost: Vec<f64> = lines.map(|line| number(line, "timeLoss") + number(line, "departDelay")).collect();
    assert!(lost.len() > 50, "{}", lost.len());
    lost.iter().sum::<f64>() / lost.len() as f64
}

fn printed_delay_s(found: &Value) -> f64 {
    found["episodes_of_plan"][0]["delay_s"].as_f64().unwrap()
}

#[test]
fn plain_sumo_has_the_delay_of_a_coordinated_plan_to_the_last_digit() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("plan");
    let args = ["--controller", "coordinated", "--episodes", "2", "--end", "900"];
    let found = plan(&shipped("arterial"), &out, &args);
    let (plain, printed) = (plain_delay_s(&found, dir.path()), printed_delay_s(&found));
    assert!((plain - printed).abs() < 1e-9, "{printed} s, but {plain} s by plain SUMO");
    let table = fs::read_to_string(out.join("plan.csv")).unwrap();
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!(header[..2], ["light", "streets"]);
    let lines: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let column = |name: &str| header.iter().position(|other| *other == name).unwrap();
    let number = |line: &[&str], name: &str| line[column(name)].parse::<u32>().unwrap();
    // All lights share a cycle, which the splits fill.
    let cycles: BTreeSet<u32> = lines.iter().map(|line| number(line, "cycle_s")).collect();
    assert_eq!(cycles.len(), 1, "{table}");
    let mut splits: BTreeMap<&str, u32> = BTreeMap::new();
    lines.iter().for_each(|line| *splits.entry(line[0]).or_default() += number(line, "split_s"));
    assert!(splits.values().all(|sum| cycles.contains(sum)), "{table}");
    let offsets: BTreeSet<u32> = lines.iter().map(|line| number(line, "offset_s")).collect();
    assert!(offsets.len() > 2, "offsets suit the roads: {table}");
    let page = fs::read_to_string(out.join("plan.html")).unwrap();
    assert!(page.contains("without the leeway"), "the delay is not that of `baseline --controller coordinated`");
    assert_eq!(page.matches("<figure>").count(), 1 + splits.len(), "a legend and a diagram for each light");
    // Another plan is not written over it.
    let refused =
        ["plan", shipped("arterial").to_str().unwrap(), "--controller", "webster", "--out", out.to_str().unwrap()]
            .map(str::to_owned);
    dials_traffic().args(refused).assert().code(2);
}

/// Cars from the south for half an hour, then from the west.
const TURN_OF_THE_TIDE: &str = r#"<routes>
    <vType id="car" speedDev="0.1"/>
    <route id="west" edges="w0_r0c0 r0c0_r0c1 r0c1_e0"/>
    <route id="south" edges="s0_r0c0 r0c0_r1c0 r1c0_n0"/>
    <flow id="a" type="car" begin="100" end="1900" vehsPerHour="700" route="south"/>
    <flow id="b" type="car" begin="100" end="1900" vehsPerHour="60" route="west"/>
    <flow id="c" type="car" begin="1900" end="3700" vehsPerHour="60" route="south"/>
    <flow id="d" type="car" begin="1900" end="3700" vehsPerHour="700" route="west"/>
</routes>"#;

fn tide() -> Room {
    let room = Room::new();
    room.change(SUMOCFG, "<end value=\"400\"/>", "<end value=\"3700\"/>");
    fs::write(room.path(CARS), TURN_OF_THE_TIDE).unwrap();
    fs::write(room.path(BUSES), "<routes/>").unwrap();
    fs::write(room.path(MORE), "<additional/>").unwrap();
    room
}

/// Returns what each light showed in each second of an episode of plain SUMO.
fn shown_by_sumo(room: &Room) -> BTreeMap<String, Vec<(u32, String, String)>> {
    let states = fs::read_to_string(room.path("states.xml")).unwrap();
    let text = |line: &str, name: &str| {
        line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().to_owned()
    };
    let mut shown: BTreeMap<String, Vec<_>> = BTreeMap::new();
    for line in states.lines().filter(|line| line.contains("<tlsState ")) {
        let second = text(line, "time").parse::<f64>().unwrap() as u32;
        shown.entry(text(line, "id")).or_default().push((second, text(line, "programID"), text(line, "state")));
    }
    shown
}

#[test]
fn a_demand_that_changes_has_plans_in_turn_and_no_light_skips_its_yellow() {
    let room = tide();
    let found = plan(&room.path(SUMOCFG), &room.path("plan"), &["--controller", "webster", "--episodes", "1"]);
    let lights = ["r0c0", "r0c1", "r1c0", "r1c1"];
    let events = lights.map(|light| format!("<timedEvent type='SaveTLSStates' source='{light}' dest='states.xml'/>"));
    fs::write(room.path(MORE), format!("<additional>{}</additional>", events.concat())).unwrap();
    assert_eq!(found["periods"], 2, "{found}");
    let (plain, printed) = (plain_delay_s(&found, room.dir.path()), printed_delay_s(&found));
    assert!((plain - printed).abs() < 1e-9, "{printed} s, but {plain} s by plain SUMO");
    let shown = shown_by_sumo(&room);
    assert_eq!(shown.len(), 4);
    let mut switching = 0;
    for (light, seconds) in &shown {
        let programs: BTreeSet<&str> = seconds.iter().map(|(_, program, _)| program.as_str()).collect();
        let programs: Vec<&str> = programs.into_iter().collect();
        // A light whose timing does not change keeps its program.
        if programs == ["webster"] {
            continue;
        }
        switching += 1;
        assert_eq!(programs, ["webster-1", "webster-2"], "{light}");
        let switched = seconds.iter().find(|(_, program, _)| program == "webster-2").unwrap().0;
        assert!((1900..2021).contains(&switched), "{light} at {switched}");
        let stays: Vec<(&str, usize)> =
            seconds.chunk_by(|one, next| one.2 == next.2).map(|stay| (stay[0].2.as_str(), stay.len())).collect();
        for pair in stays[1..].windows(2) {
            let lost = pair[0].0.chars().zip(pair[1].0.chars()).any(|(old, new)| "gG".contains(old) && new == 'r');
            assert!(!lost, "{light} goes from {} to {}", pair[0].0, pair[1].0);
            let least = if pair[0].0.contains('y') { 3..=3 } else { 5..=usize::MAX };
            assert!(least.contains(&pair[0].1), "{light} shows {} for {} s", pair[0].0, pair[0].1);
        }
    }
    assert!(switching >= 2, "{switching} lights switch");
    // Its directory is a player like others, with other demand, too.
    fs::write(room.path(MORE), "<additional/>").unwrap();
    let compared = format!("program,{}", room.path("plan").display());
    let mut command = dials_traffic();
    let scenario = room.path(SUMOCFG);
    let args = ["baseline", scenario.to_str().unwrap(), "--compare", &compared, "--episodes", "1", "--demand", "1,0.5"];
    let played = json(&command.args(args).arg("--json").assert().success().get_output().stdout);
    let delays = ["/variants/0/controllers/1", "/variants/1/controllers/1"]
        .map(|player| &played.pointer(player).unwrap()["delay_s"]);
    assert!((delays[0].as_f64().unwrap() - printed).abs() < 1e-9, "{printed} s, but {}", delays[0]);
    assert!(delays[1].as_f64().unwrap() < printed, "half of the cars lose less");
}

/// A junction of four arms with a crossing of 9.6 m over each.
const CROSSINGS: &str = include_str!("../../../crates/traffic/src/agents/derive/crossing.net.xml");
/// Cars from all sides, and people on foot.
const ON_FOOT: &str = r#"<routes>
    <flow id="a" begin="0" end="600" vehsPerHour="400" from="top0A0" to="A0bottom0"/>
    <flow id="b" begin="0" end="600" vehsPerHour="400" from="left0A0" to="A0right0"/>
    <flow id="c" begin="0" end="600" vehsPerHour="200" from="right0A0" to="A0top0"/>
    <personFlow id="d" begin="0" end="600" period="10"><walk from="left0A0" to="A0bottom0"/></personFlow>
    <personFlow id="e" begin="0" end="600" period="10"><walk from="top0A0" to="A0right0"/></personFlow>
</routes>"#;

#[test]
fn plans_let_people_who_have_just_begun_to_cross_get_across() {
    let room = Room::new();
    for (name, text) in [("roads.net.xml", CROSSINGS), ("on_foot.rou.xml", ON_FOOT)] {
        fs::write(room.path(name), text).unwrap();
    }
    let states = "<additional><timedEvent type='SaveTLSStates' source='A0' dest='states.xml'/></additional>";
    fs::write(room.path("states.add.xml"), states).unwrap();
    let config = r#"<configuration><net-file value="roads.net.xml"/><route-files value="on_foot.rou.xml"/>
        <additional-files value="states.add.xml"/><end value="700"/></configuration>"#;
    fs::write(room.path("people.sumocfg"), config).unwrap();
    let args = ["--controller", "webster", "--episodes", "1"];
    let found = plan(&room.path("people.sumocfg"), &room.path("plan"), &args);
    let (plain, printed) = (plain_delay_s(&found, room.dir.path()), printed_delay_s(&found));
    assert!((plain - printed).abs() < 1e-9, "{printed} s, but {plain} s by plain SUMO");
    // Letters 12 to 15 are crossings: 9.6 m at 1.07 m/s are 9 s.
    let opens = |before: &str, now: &str, letters: std::ops::Range<usize>| {
        let is_green = |state: &str, letter: usize| "gG".contains(state.as_bytes()[letter] as char);
        letters.clone().any(|letter| !is_green(before, letter) && is_green(now, letter))
    };
    let shown = &shown_by_sumo(&room)["A0"];
    let (mut ended, mut changes) = (None, 0);
    for pair in shown.windows(2) {
        let [(_, _, before), (second, _, now)] = pair else { unreachable!() };
        if opens(now, before, 12..16) {
            ended = Some(*second);
        }
        if let Some(ended) = ended.filter(|_| opens(before, now, 0..12)) {
            assert!(second - ended >= 9, "{now} {} s after the walk", second - ended);
            changes += 1;
        }
    }
    assert!(changes > 10, "{changes} greens after a walk");
    let table = fs::read_to_string(room.path("plan/plan.csv")).unwrap();
    let column = table.lines().next().unwrap().split(',').position(|name| name == "pedestrian_clearance_s").unwrap();
    let clearances: Vec<&str> = table.lines().skip(1).map(|line| line.split(',').nth(column).unwrap()).collect();
    assert!(clearances.contains(&"6"), "3 of 9 s are yellow: {table}");
}

#[test]
fn a_rule_that_looks_at_the_traffic_is_frozen_or_written_as_actuated_programs() {
    let room = tide();
    room.change(SUMOCFG, "<end value=\"3700\"/>", "<end value=\"1000\"/>");
    let freeze = |out: &str, more: &[&str]| {
        let args = ["--controller", "max-pressure:min-green=5", "--episodes", "2", "--watch-episodes", "1"];
        let args: Vec<&str> = args.iter().chain(more).copied().collect();
        let found = plan(&room.path(SUMOCFG), &room.path(out), &args);
        let (plain, printed) = (plain_delay_s(&found, room.dir.path()), printed_delay_s(&found));
        assert!((plain - printed).abs() < 1e-9, "{printed} s, but {plain} s by plain SUMO");
        let lost = found["delay_plan_s"].as_f64().unwrap() - found["delay_of_watched_s"].as_f64().unwrap();
        assert!((found["delay_lost_by_freezing_s"]["mean"].as_f64().unwrap() - lost).abs() < 1e-9);
        fs::read_to_string(room.path(out).join("programs.add.xml")).unwrap()
    };
    let fixed = freeze("fixed", &[]);
    assert_eq!(fixed.matches("type=\"static\" programID=\"max-pressure\"").count(), 4, "{fixed}");
    let actuated = freeze("actuated", &["--actuated"]);
    assert_eq!(actuated.matches("type=\"actuated\" programID=\"max-pressure-actuated\"").count(), 4, "{actuated}");
    let seconds = |key: &str| {
        let key = format!(" {key}=\"");
        let values = actuated.split(&key).skip(1);
        values.map(|rest| rest.split('"').next().unwrap().parse::<u32>().unwrap()).collect::<Vec<_>>()
    };
    let (least, most) = (seconds("minDur"), seconds("maxDur"));
    assert!(
        least.len() >= 4 && least.iter().zip(&most).all(|(least, most)| 1 <= *least && least <= most),
        "{actuated}"
    );
}

#[test]
fn plans_that_make_no_sense_get_the_way_out() {
    let room = tide();
    for (args, why) in [
        (&[][..], "--controller: is missing; name `fixed-time`"),
        (&["--controller", "webster", "--actuated"], "needs greens that vary, and those of `webster` do not"),
        (
            &["--controller", "webster", "--greedy"],
            "is for the policies of a run directory, and `webster` is a controller",
        ),
        (&["--controller", "webster,fixed-time"], "names several; a plan is made of one"),
        (&["--controller", "fastest"], "controller `fastest`: unknown; one of"),
        (&["--controller", "runs/none"], "runs/none: no such run directory"),
        (&["--controller", "fixed-time:speed=3"], "has no parameter `speed`"),
        (&["--controller", "webster", "--tune"], "this plan has 2 periods, and only one can be tuned"),
    ] {
        let mut command = dials_traffic();
        let place = [room.path(SUMOCFG), room.path("none")];
        command.arg("plan").arg(&place[0]).arg("--out").arg(&place[1]).args(["--episodes", "1"]).args(args);
        let output = command.assert().code(2).get_output().clone();
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(told.contains(why), "{args:?}: {told}");
        assert!(!place[1].exists());
    }
}
