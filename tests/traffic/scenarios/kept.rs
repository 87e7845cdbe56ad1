//! The copy in a run directory, the checksum, and what SUMO loads.

use std::fs;
use std::path::Path;
use std::process::Command;

use dials_traffic::config::ScenarioConfig;
use dials_traffic::scenario::SumoScenario;
use libsumo::Simulation;

use super::room::{BUSES, CARS, MORE, NET, Room, SUMOCFG, names, table};
use crate::plain_sumo;

#[test]
fn a_copy_holds_plain_names_and_is_the_same_scenario() {
    let room = Room::new();
    fs::create_dir(room.path("deep")).unwrap();
    fs::rename(room.path(CARS), room.path("deep/my cars.xml")).unwrap();
    room.change(SUMOCFG, "cars.rou.xml", &room.path("deep/../deep/my%20cars.xml").display().to_string());
    fs::write(room.path("overrides.toml"), "# nothing yet\n").unwrap();
    let config = room.config(&[&format!("traffic.agents={}", room.path("overrides.toml").display())]).unwrap();
    let scenario = SumoScenario::read(&table(config.clone())).unwrap();
    let kept = scenario.keep_in(&room.path("run")).unwrap();
    assert_eq!(kept, [Path::new("scenario.sumocfg"), Path::new("agents.toml")]);
    let expected = [
        "agents.toml",
        "scenario.1.add.xml",
        "scenario.1.rou.xml",
        "scenario.2.rou.xml",
        "scenario.net.xml",
        "scenario.sumocfg",
    ];
    assert_eq!(names(&room.path("run")), expected);
    // What is left out of a file is not in the copy, and a file of which nothing is left out is copied to the byte.
    assert!(!fs::read_to_string(room.path("run/scenario.1.add.xml")).unwrap().contains("victim"));
    assert!(!fs::read_to_string(room.path("run/scenario.sumocfg")).unwrap().contains("victim"));
    assert_eq!(fs::read(room.path("run/scenario.net.xml")).unwrap(), fs::read(room.path(NET)).unwrap());

    let of_the_copy = ScenarioConfig {
        scenario: room.path("run/scenario.sumocfg"),
        agents: Some(room.path("run/agents.toml")),
        ..table(config)
    };
    let copy = SumoScenario::read(&of_the_copy).unwrap();
    assert_eq!(copy.checksum(), scenario.checksum());
    assert_eq!(copy.notes().left_out.len(), 1, "a vehicle departs too early: {:?}", copy.notes().left_out);
    copy.keep_in(&room.path("again")).unwrap();
    for name in expected {
        let [first, second] = ["run", "again"].map(|dir| fs::read(room.path(dir).join(name)).unwrap());
        assert!(first == second, "{name} of a copy of a copy differs");
    }
    let folder_is_taken = copy.keep_in(&room.path("again")).unwrap_err().to_string();
    assert!(folder_is_taken.ends_with("again: cannot be made"));
}

#[test]
fn a_packed_scenario_is_the_same_and_is_kept_unpacked() {
    let room = Room::new();
    let plain = room.read().unwrap();
    plain.keep_in(&room.path("plain")).unwrap();
    for file in [NET, CARS, BUSES, MORE] {
        assert!(Command::new("gzip").arg(room.path(file)).status().unwrap().success());
        room.change(SUMOCFG, file, &format!("{file}.gz"));
    }
    let packed = room.read().unwrap();
    assert!(packed.net_path().ends_with(format!("{NET}.gz")));
    assert_eq!((packed.checksum(), packed.notes().left_out.len()), (plain.checksum(), plain.notes().left_out.len()));
    packed.keep_in(&room.path("packed")).unwrap();
    assert_eq!(names(&room.path("packed")), names(&room.path("plain")));
    for name in names(&room.path("plain")) {
        let [packed, plain] = ["packed", "plain"].map(|dir| fs::read(room.path(dir).join(&name)).unwrap());
        assert!(packed == plain, "{name}");
    }
    fs::write(room.path(&format!("{NET}.gz")), b"\x1f\x8b\x08\x00").unwrap();
    let told = room.error();
    assert!(told.starts_with("DIR/net.net.xml.gz: could not be read: it is packed with gzip, but damaged ("), "{told}");
}

#[test]
fn the_checksum_changes_with_everything_that_decides_what_returns_mean() {
    let room = Room::new();
    let original = room.read().unwrap().checksum();
    let with = |setting: &str| SumoScenario::read(&table(room.config(&[setting]).unwrap())).unwrap().checksum();
    for setting in ["traffic.decision_s=6", "traffic.yellow_s=4", "traffic.reward=queue", "traffic.end_s=390"] {
        assert_ne!(with(setting), original, "{setting}");
    }
    for setting in ["traffic.observation=queues", "traffic.reward={queue=0.1}", "traffic.begin_s=100", "seed=9"] {
        assert_eq!(with(setting), original, "{setting}");
    }
    let changes = [
        (CARS, "period=\"8\"", "period=\"9\""),
        (BUSES, "length=\"12\"", "length=\"13\""),
        (MORE, "sigma=\"0.5\"", "sigma=\"0.4\""),
        (SUMOCFG, "value=\"300\"", "value=\"200\""),
    ];
    for (file, from, to) in changes {
        let room = Room::new();
        room.change(file, from, to);
        assert_ne!(room.read().unwrap().checksum(), original, "{to}");
    }
    let commented = Room::new();
    commented.change(CARS, "<routes>", "<!-- a remark --><routes>");
    assert_eq!(commented.read().unwrap().checksum(), original, "SUMO does not read it");
}

#[test]
fn sumo_loads_what_was_read_and_plain_sumo_the_copy() {
    let room = Room::new();
    let scenario = room.read().unwrap();
    scenario.keep_in(&room.path("run")).unwrap();
    // The files may change or go: SUMO loads what was read.
    for file in [NET, CARS, BUSES, MORE] {
        fs::remove_file(room.path(file)).unwrap();
    }
    let loadable = scenario.for_sumo("<additional/>", "actuated").unwrap();
    let options = loadable.options(false, 42);
    let mut simulation = Simulation::load(&options).map_err(|error| loadable.explain(&error)).unwrap();
    assert_eq!(simulation.time_s().unwrap(), 100.0);
    let mut departed = 0;
    for _ in 100..400 {
        simulation.step().unwrap();
        departed += simulation.departures().unwrap().len();
    }
    drop(simulation);

    let output = Command::new(plain_sumo())
        .args(["-c", "scenario.sumocfg", "--seed", "42", "--no-step-log", "true", "--duration-log.statistics", "true"])
        .current_dir(room.path("run"))
        .output()
        .unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    // One trip, two vehicles, 30 cars of a flow and about 10 buses.
    assert!(said.contains(&format!("Inserted: {departed}\n")), "{departed}: {said}");
    assert!((41..=44).contains(&departed), "{departed}");
    assert_eq!(fs::read_to_string(room.victim()).unwrap(), "precious");
    let written = names(&room.path("run"));
    assert_eq!(written.len(), 5, "sumo wrote a file: {written:?}");
}
