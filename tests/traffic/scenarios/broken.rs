//! Ways to break a scenario, and what is said of each.

use std::fs;

use dials_traffic::config::ScenarioConfig;
use dials_traffic::scenario::SumoScenario;

use super::room::{BUSES, CARS, MORE, NET, Room, SUMOCFG, names, table};

/// A file, a text in it, what takes its place, and the error.
type Break = (&'static str, &'static str, &'static str, &'static str);

/// Ways to break the .sumocfg: a text in it, what takes its place, and the error.
const BROKEN_CONFIGURATIONS: &[[&str; 3]] = &[
    [
        "net.net.xml",
        "no.net.xml",
        "DIR/x.sumocfg: <net-file> names DIR/no.net.xml, and there is no such file; correct the path",
    ],
    [
        "cars.rou.xml",
        "../no.xml",
        "DIR/x.sumocfg: <route-files> names DIR/../no.xml, and there is no such file; correct the path",
    ],
    [
        "more.add.xml",
        "/no/such.add.xml",
        "DIR/x.sumocfg: <additional-files> names /no/such.add.xml, and there is no such file; correct the path",
    ],
    ["cars.rou.xml", "/dev/zero", "/dev/zero: could not be read: it is not a regular file"],
    ["<net-file value=\"net.net.xml\"/>", "", "DIR/x.sumocfg: names no net; add <net-file value=\"...\"/>"],
    ["net.net.xml", "more.add.xml", "DIR/more.add.xml: is no net of SUMO: its root is <additional>, not <net>"],
    [
        "cars.rou.xml",
        "net.net.xml",
        "DIR/net.net.xml: is a net, and <route-files> of DIR/x.sumocfg names it; correct the path",
    ],
    [
        "<begin value=\"100\"/>",
        "<begin value=\"400\"/>",
        "DIR/x.sumocfg: <begin value=\"400\">: must be before <end value=\"400\">, so nothing would be simulated",
    ],
    [
        "<end value=\"400\"/>",
        "<end value=\"noon\"/>",
        "DIR/x.sumocfg: <end>: `noon` is no time: it must be seconds, such as 3600, or 01:00:00",
    ],
    [
        "<input>",
        "<input><load-state value=\"s.xml\"/>",
        "DIR/x.sumocfg: <load-state>: is s.xml, and it reads a file that this program does not copy into a run directory; remove it",
    ],
    [
        "<processing>",
        "<processing><frobnicate value=\"1\"/>",
        "DIR/x.sumocfg: <frobnicate>: is no option of SUMO that this program knows; remove it",
    ],
    [
        "<processing>",
        "<processing><eager-insert value=\"--tripinfo-output=VICTIM\"/>",
        "DIR/x.sumocfg: <eager-insert>: is `--tripinfo-output=VICTIM`, which is no value of it; remove it",
    ],
    ["<time>", "<time><begin value=\"7\"/>", "DIR/x.sumocfg: <begin>: is given twice; remove one of them"],
    ["</configuration>", "", "DIR/x.sumocfg: is not XML: the root node was opened but never closed"],
    [
        "<configuration>",
        "<!DOCTYPE x [<!ENTITY y SYSTEM '/etc/passwd'>]><configuration>",
        "DIR/x.sumocfg: has a document type (<!DOCTYPE ...>), which SUMO's files do not need",
    ],
];

/// Ways to break the net and the demand that SUMO takes in silence, or that this program does not simulate.
const REFUSED: &[Break] = &[
    (
        NET,
        "<connection from=\"e0_r0c1\"",
        "<connection from=\"no\"",
        "DIR/net.net.xml: <connection from=\"no\" fromLane=\"0\" to=\"r0c1_r0c0\" toLane=\"0\">: from=\"no\": the net has none of this name; make the net again with netconvert",
    ),
    (
        BUSES,
        "length=\"12\"",
        "length=\"12\" decel=\"nan\"",
        "DIR/buses.rou.xml: <vType id=\"bus\">: decel=\"nan\": must be a finite number; correct it",
    ),
    (
        MORE,
        "</additional>",
        "<rerouter id=\"r\" edges=\"w0_r0c0\" file=\"VICTIM\"/></additional>",
        "VICTIM: is not XML: unknown token at 1:1",
    ),
    (MORE, "</additional>", "<include href=\"VICTIM\"/></additional>", "VICTIM: is not XML: unknown token at 1:1"),
];

/// Ways to break a scenario that SUMO judges, and its words: by file.
const JUDGED_BY_SUMO: [(&str, &[[&str; 3]]); 3] = [
    (
        CARS,
        &[
            ["from=\"w0_r0c0\"", "from=\"no\"", "The edge 'no' within the route for trip 'early' is not known."],
            [
                "edges=\"s0_r0c0 r0c0_r1c0\"",
                "edges=\"s0_r0c0 e0_r0c1\"",
                "Vehicle 'w' has no valid route. No connection between edge 's0_r0c0' and edge 'e0_r0c1'.",
            ],
            ["to=\"r0c1_s1\"", "to=\"r0c0_w0\"", "Vehicle 'f.0' has no valid route."],
            ["route=\"west\"", "route=\"east\"", "The route 'east' for vehicle 'v' is not known."],
            ["type=\"mixed\"", "type=\"lory\"", "The vehicle type 'lory' for flow 'f' is not known."],
            ["id=\"v\"", "id=\"t\"", "Another vehicle with the id 't' exists."],
            ["depart=\"120.00\"", "depart=\"later\"", "Invalid departure time for vehicle 't';"],
            ["depart=\"120.00\"", "", "Attribute 'depart' is missing in definition of trip 't'."],
            ["route=\"west\"", "", "Vehicle 'v' has no route."],
            [
                "period=\"8\"",
                "period=\"often\"",
                "Attribute 'period' in definition of flow 'f' is not a valid time value.",
            ],
            ["end=\"390\"", "end=\"149\"", "Flow 'f' ends before its begin time."],
        ],
    ),
    (
        BUSES,
        &[
            ["id=\"g\"", "id=\"f\"", "Another flow with the id 'f' exists."],
            ["length=\"12\"", "length=\"-12\"", "length must be greater than 0"],
        ],
    ),
    (
        MORE,
        &[
            ["vTypes=\"car lorry\"", "vTypes=\"car ship\"", "Unknown vtype 'ship' in distribution 'mixed'."],
            [
                "</additional>",
                "<tlLogic id=\"r0c0\" type=\"static\" programID=\"0\"><phase duration=\"9\" state=\"GGGG\"/></tlLogic></additional>",
                "Another logic with id 'r0c0' and programID '0' exists.",
            ],
        ],
    ),
];

#[test]
fn every_broken_scenario_gets_one_clear_error() {
    let configurations = BROKEN_CONFIGURATIONS.iter().map(|&[from, to, message]| (SUMOCFG, from, to, message));
    for (file, from, to, message) in configurations.chain(REFUSED.iter().copied()) {
        let room = Room::new();
        let victim = room.victim().display().to_string();
        room.change(file, from, &to.replace("VICTIM", &victim));
        let before = names(room.dir.path());
        assert_eq!(
            room.error(),
            message.replace("VICTIM", &victim).replace(&format!("{}/", room.dir.path().display()), "DIR/")
        );
        assert_eq!(
            (names(room.dir.path()), fs::read_to_string(room.victim()).unwrap()),
            (before, "precious".to_owned())
        );
    }
}

#[test]
fn what_sumo_judges_is_said_in_its_own_words() {
    let breaks = JUDGED_BY_SUMO.into_iter().flat_map(|(file, breaks)| breaks.iter().map(move |found| (file, found)));
    for (file, [from, to, words]) in breaks {
        let room = Room::new();
        room.change(file, from, to);
        let said = refused(&room, &["baseline", "../x.sumocfg", "--controller", "program", "--episodes", "1"]);
        let begins = "error: ../x.sumocfg: SUMO cannot simulate this scenario; try it with: sumo -c ../x.sumocfg\n  caused by: SUMO: ";
        assert!(said.starts_with(begins) && said.contains(words), "{words}: {said}");
        assert!(said.len() < 600 && !said.contains("/proc/"), "{said}");
    }
}

/// Runs a command in an empty folder of the room. It must refuse the scenario and write nothing. Returns its words.
fn refused(room: &Room, words: &[&str]) -> String {
    fs::create_dir(room.path("here")).unwrap();
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    let output = command.args(words).current_dir(room.path("here")).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert_eq!(names(&room.path("here")), [""; 0]);
    said
}

#[test]
fn a_net_without_lights_and_a_time_without_traffic_are_refused() {
    let room = Room::new();
    let net = fs::read_to_string(room.path(NET)).unwrap();
    let light = |line: &str| ["<tlLogic", "<phase", "</tlLogic"].iter().any(|tag| line.trim_start().starts_with(tag));
    let dark: Vec<String> = net.lines().filter(|line| !light(line)).map(|line| format!("{line}\n")).collect();
    fs::write(room.path(NET), dark.concat()).unwrap();
    assert_eq!(
        room.error(),
        "DIR/net.net.xml: has no traffic light (<tlLogic>); make some with: netconvert -s DIR/net.net.xml --tls.set \
         JUNCTION,... -o NEW.net.xml"
    );
    let room = Room::new();
    let table = ScenarioConfig { begin_s: Some(500), end_s: Some(600), ..table(room.config(&[]).unwrap()) };
    let error = SumoScenario::read(&table).unwrap_err().to_string();
    assert!(
        error.ends_with("x.sumocfg: no vehicle departs from 500 to 600 s; add a route file, or correct begin and end")
    );
}

#[test]
fn a_broken_scenario_ends_a_training_before_it_writes_anything() {
    let room = Room::new();
    room.change(CARS, "from=\"w0_r0c0\"", "from=\"no\"");
    let said = refused(&room, &["train", "../x.sumocfg"]);
    assert!(said.contains("The edge 'no' within the route for trip 'early' is not known."), "{said}");
}
