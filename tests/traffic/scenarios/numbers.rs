//! Numbers that SUMO takes in silence, and of which it dies, never comes back, floods the memory, or lets no car in.

use std::collections::HashSet;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Output};

use dials_core::base::{AgentId, Seed};
use dials_core::domain::{Domain, GlobalSimulator};
use dials_traffic::Traffic;
use dials_traffic::controllers::HandCoded;
use dials_traffic::sim::control::SignalControl;

use super::room::{BUSES, CARS, MORE, Room, SUMOCFG, table};
use crate::plain_sumo;

/// Each of these once ended a command in the middle of an episode, or never, or was played without a car: a file, a text in
/// it, what takes its place, and the error.
const REFUSED: &[(&str, &str, &str, &str)] = &[
    (
        MORE,
        "speedDev=\"0.1\"",
        "speedFactor=\"nan\"",
        "DIR/more.add.xml: <vType id=\"car\">: speedFactor=\"nan\": must be a finite number; correct it",
    ),
    (
        MORE,
        "speedDev=\"0.1\"",
        "jmSigmaMinor=\"nan\"",
        "DIR/more.add.xml: <vType id=\"car\">: jmSigmaMinor=\"nan\": must be a finite number; correct it",
    ),
    (
        MORE,
        "speedDev=\"0.1\"",
        "scale=\"nan\"",
        "DIR/more.add.xml: <vType id=\"car\">: scale=\"nan\": must be a finite number; correct it",
    ),
    // SUMO reads these as C does, and another reader takes them for words.
    (
        MORE,
        "speedDev=\"0.1\"",
        "scale=\" nan\"",
        "DIR/more.add.xml: <vType id=\"car\">: scale=\" nan\": must be a finite number; correct it",
    ),
    (
        MORE,
        "speedDev=\"0.1\"",
        "jmSigmaMinor=\"nan(1)\"",
        "DIR/more.add.xml: <vType id=\"car\">: jmSigmaMinor=\"nan(1)\": must be a finite number; correct it",
    ),
    (
        MORE,
        "speedDev=\"0.1\"",
        "speedDev=\"1e9\"",
        "DIR/more.add.xml: <vType id=\"car\">: speedDev=\"1e9\": must be from -1000 to 1000; correct it",
    ),
    (
        MORE,
        "speedDev=\"0.1\"",
        "scale=\"1e9\"",
        "DIR/more.add.xml: <vType id=\"car\">: scale=\"1e9\": must be from -100000 to 100000; correct it",
    ),
    (
        MORE,
        "speedDev=\"0.1\"",
        "speedFactor=\"normc(1,0.1,1,1)\"",
        "DIR/more.add.xml: <vType id=\"car\">: speedFactor=\"normc(1,0.1,1,1)\": SUMO draws a number until it is from 1 to 1, \
         which almost never happens; give normc wider bounds, or a deviation of 0; correct it",
    ),
    (
        SUMOCFG,
        "<processing>",
        "<processing><weights.minor-penalty value=\"nan\"/>",
        "DIR/x.sumocfg: <weights.minor-penalty>: is `nan`: must be a finite number; correct it",
    ),
    (
        SUMOCFG,
        "<processing>",
        "<processing><default.speeddev value=\"1e308\"/>",
        "DIR/x.sumocfg: <default.speeddev>: is `1e308`: must be from -1000 to 1000; correct it",
    ),
    (
        SUMOCFG,
        "<processing>",
        "<processing><scale value=\"1e9\"/>",
        "DIR/x.sumocfg: <scale>: is `1e9`: must be from -100000 to 100000; correct it",
    ),
    (
        SUMOCFG,
        "<processing>",
        "<processing><device.rerouting.adaptation-steps value=\"2147483647\"/>",
        "DIR/x.sumocfg: <device.rerouting.adaptation-steps>: is `2147483647`: must be from -1000000 to 100000; correct it",
    ),
    (
        CARS,
        "<route id=\"west\"",
        "<route repeat=\"300000000\" id=\"west\"",
        "DIR/cars.rou.xml: <route id=\"west\">: repeat=\"300000000\": must be from -1000000 to 10000000; correct it",
    ),
    (
        CARS,
        "<route id=\"west\"",
        "<route repeat=\"4000000\" id=\"west\"",
        "DIR/cars.rou.xml: <route id=\"west\">: repeat=\"4000000\": with it the routes have 12000000 edges, and at most 10000000 \
         are allowed; correct it",
    ),
    (
        BUSES,
        "vehsPerHour=\"120\"",
        "vehsPerHour=\"inf\"",
        "DIR/buses.rou.xml: <flow id=\"g\">: vehsPerHour=\"inf\": must be a finite number; correct it",
    ),
    (
        CARS,
        "depart=\"130\"",
        "depart=\"nan\"",
        "DIR/cars.rou.xml: <vehicle id=\"v\">: depart=\"nan\": must be a finite number; correct it",
    ),
];

/// Numbers that look strange, and with which SUMO plays as it should.
const PLAYED: &[(&str, &str, &str)] = &[
    (MORE, "speedDev=\"0.1\"", "speedFactor=\"normc(1,0.1,0.2,2)\" maxSpeed=\"inf\" impatience=\"off\""),
    (MORE, "speedDev=\"0.1\"", "speedFactor=\"normc(1,0,1,1)\" actionStepLength=\"1\" minGap=\"0x1p1\" scale=\"2\""),
    (
        MORE,
        "speedDev=\"0.1\"",
        "speedFactor=\"norm(1,0.1)\" lcStrategic=\"1e9\" jmTimegapMinor=\"0\" lcAssertive=\"1e6\"",
    ),
    (CARS, "period=\"8\"", "period=\"exp(0.125)\" departPos=\"random\" departSpeed=\"max\" arrivalPos=\"max\""),
    (CARS, "depart=\"130\"", "depart=\"0:02:10\" departLane=\"best\" arrivalPos=\"-1\""),
    (CARS, "<route id=\"west\"", "<route repeat=\"0\" cycleTime=\"60\" id=\"west\""),
    (SUMOCFG, "<processing>", "<processing><scale value=\"1.5\"/><max-num-vehicles value=\"2147483647\"/>"),
    (SUMOCFG, "<processing>", "<processing><time-to-impatience value=\"1e9\"/><weights.minor-penalty value=\"0\"/>"),
    (SUMOCFG, "<processing>", "<processing><default.speeddev value=\"0.1\"/><default.action-step-length value=\"1\"/>"),
];

#[test]
fn numbers_without_a_size_are_refused_where_they_stand() {
    for &(file, from, to, message) in REFUSED {
        let room = Room::new();
        room.change(file, from, to);
        assert_eq!(room.error(), message, "{to}");
    }
}

#[test]
fn numbers_that_only_look_strange_are_played() {
    for &(file, from, to) in PLAYED {
        let room = Room::new();
        room.change(file, from, to);
        let departed = played(&room).unwrap_or_else(|error| panic!("{to}: {error:#}"));
        assert!(departed > 10.0, "{to}: {departed}");
    }
}

/// Plays an episode. Returns how many cars entered.
fn played(room: &Room) -> anyhow::Result<f64> {
    let traffic = Traffic::open_scenario(&table(room.config(&[])?))?;
    let mut gs = traffic
        .global(SignalControl::HandCoded { by: HandCoded::OwnProgram, agents: AgentId::all(traffic.agents()) })?;
    gs.reset(Seed::new(3))?;
    for _ in 0..traffic.kinds().horizon() {
        gs.step(&vec![0; traffic.agents()])?;
    }
    let measures = gs.measures()?;
    Ok(measures.system.iter().find(|(name, _)| name == "departed").expect("it is counted").1)
}

#[test]
fn all_that_sumo_makes_of_a_car_counts_against_the_largest_number_of_cars() {
    for (changes, message) in [
        (
            &[
                (SUMOCFG, "<processing>", "<processing><scale value=\"100000\"/>"),
                (CARS, "period=\"8\"", "period=\"1\""),
            ][..],
            "vehicles depart from 100 to 400 s, and at most 10000000 are allowed; correct the flows, or scale",
        ),
        (
            &[(MORE, "vClass=\"truck\"", "vClass=\"truck\" scale=\"100000\""), (CARS, "period=\"8\"", "period=\"1\"")],
            "vehicles depart from 100 to 400 s, and at most 10000000 are allowed; correct the flows, or scale",
        ),
        (
            &[(SUMOCFG, "<processing>", "<processing><scale value=\"0\"/>")],
            "x.sumocfg: option scale is 0, so SUMO makes no vehicle; correct it",
        ),
    ] {
        let room = Room::new();
        changes.iter().for_each(|&(file, from, to)| room.change(file, from, to));
        assert!(room.error().ends_with(message), "{}", room.error());
    }
}

#[test]
fn an_episode_into_which_no_car_comes_is_an_error() {
    for (file, from, to) in [
        (SUMOCFG, "<processing>", "<processing><max-num-vehicles value=\"0\"/>"),
        (SUMOCFG, "<processing>", "<processing><max-depart-delay value=\"1\"/><max-num-vehicles value=\"0\"/>"),
    ] {
        let room = Room::new();
        room.change(file, from, to);
        let error = played(&room).expect_err("it has no cars").to_string();
        let path = room.path(SUMOCFG).display().to_string();
        assert!(
            error.starts_with(&format!("{path}: not one vehicle entered from 100 to 400 s, but at least ")),
            "{error}"
        );
        assert!(error.ends_with(&format!("sumo -c {path}")), "{error}");
    }
}

#[test]
fn an_episode_without_cars_is_played_where_nobody_wants_to_come() {
    let persons = "<routes><person id=\"p\" depart=\"120\"><walk edges=\"w0_r0c0\"/></person></routes>";
    // The probability that a car comes is 3 %.
    let seldom = "<routes><flow id=\"f\" begin=\"100\" end=\"400\" probability=\"0.0001\" from=\"w0_r0c0\" \
                  to=\"r0c1_e0\"/></routes>";
    // It may find no room before the end.
    let late = "<routes><trip id=\"t\" depart=\"399.5\" from=\"w0_r0c0\" to=\"r0c1_e0\"/></routes>";
    for routes in ["<routes/>", persons, seldom, late] {
        let room = Room::new();
        fs::write(room.path(CARS), routes).unwrap();
        fs::write(room.path(BUSES), "<routes/>").unwrap();
        assert_eq!(played(&room).unwrap_or_else(|error| panic!("{routes}: {error:#}")), 0.0, "{routes}");
    }
}

/// Runs a command on a scenario of which SUMO dies in the middle of an episode: the first car that wants to change lanes
/// breaks an assertion of SUMO 1.15. `None`: this SUMO has its assertions off.
fn dead(words: &[&str]) -> Option<Output> {
    let dir = tempfile::tempdir().unwrap();
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/arterial");
    for ending in ["net.xml", "rou.xml", "sumocfg"] {
        let mut text = fs::read_to_string(shipped.join(format!("arterial.{ending}"))).unwrap();
        text = text.replace("<vType ", "<vType actionStepLength=\"100\" ");
        fs::write(dir.path().join(format!("arterial.{ending}")), text).unwrap();
    }
    let output =
        assert_cmd::cargo::cargo_bin_cmd!("dials-traffic").args(words).current_dir(dir.path()).output().unwrap();
    (!output.status.success()).then_some(output)
}

#[test]
fn the_death_of_sumo_in_an_episode_names_the_scenario_the_second_and_the_way_out() {
    for (words, scenario) in [
        (&["baseline", "arterial.sumocfg", "--controller", "program", "--episodes", "1"][..], "arterial.sumocfg"),
        (&["replay", "arterial.sumocfg", "--controller", "program", "--out", "kept"], "arterial.sumocfg"),
        (&["check", "arterial.sumocfg"], "arterial.sumocfg"),
        // A run simulates its own copy. The last lines of a worker's log are part of the coordinator's error.
        (&["train", "arterial.sumocfg", "--workers", "0", "--out", "run"], "run/networks/scenario.sumocfg"),
        (&["train", "arterial.sumocfg", "--workers", "1", "--out", "run"], "run/networks/scenario.sumocfg"),
    ] {
        let Some(output) = dead(words) else { return eprintln!("this SUMO has its assertions off: nothing to see") };
        let said = String::from_utf8_lossy(&output.stderr);
        let died = format!("error: {scenario}: SUMO died at second ");
        let (before, after) = said.split_once(&died).unwrap_or_else(|| panic!("{words:?}: {said}"));
        assert!(before.contains("Assertion") || before.contains("MSLCM_"), "SUMO's words come first: {said}");
        assert!(after.contains(" of an episode, of signal 6; its last words"), "{said}");
        assert!(after.contains("way out: correct the numbers of its vehicles"), "{said}");
        assert!(after.contains(&format!("sumo -c {scenario}")), "{said}");
        assert!(output.status.signal() == Some(6) || words.contains(&"1"), "{words:?}");
    }
}

#[test]
fn every_option_of_the_installed_sumo_that_is_a_number_is_in_the_table() {
    const TABLE: &str = include_str!("../../../crates/traffic/src/config/sumo_numbers/table.txt");
    let known: HashSet<&str> = TABLE.split_whitespace().collect();
    let help = Command::new(plain_sumo()).arg("--help").output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    // Such as `  -e, --end TIME   Defines the end time`.
    let number = |line: &'_ str| {
        let (_, rest) = line.split_once("--")?;
        let mut words = rest.split_whitespace();
        let (name, kind) = (words.next()?, words.next()?);
        ["FLOAT", "INT", "TIME"].contains(&kind).then(|| name.to_owned())
    };
    let numbers: Vec<String> = help.lines().filter(|line| line.starts_with("  -")).filter_map(number).collect();
    assert!(numbers.len() > 100, "{}", numbers.len());
    let missing: Vec<_> = numbers.iter().filter(|name| !known.contains(name.as_str())).collect();
    assert!(missing.is_empty(), "make the table again with sumo_numbers/make.py: it lacks {missing:?}");
}
