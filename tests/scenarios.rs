//! Scenarios of users: what is read, what is refused with which words, and what a run directory keeps.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use dials_traffic::config::{Config, DomainConfig, ScenarioConfig, Simulator, load};
use dials_traffic::sumo::Simulation;
use dials_traffic::traffic::scenario::SumoScenario;
use tempfile::TempDir;

const SUMOCFG: &str = "x.sumocfg";
const NET: &str = "net.net.xml";
const CARS: &str = "cars.rou.xml";
const BUSES: &str = "buses.rou.xml";
const MORE: &str = "more.add.xml";

const CONFIGURATION: &str = r#"<configuration>
    <input>
        <net-file value="net.net.xml"/>
        <route-files value="cars.rou.xml,buses.rou.xml"/>
        <additional-files value="more.add.xml"/>
    </input>
    <time><begin value="100"/><end value="400"/></time>
    <processing><time-to-teleport value="300"/></processing>
    <output><tripinfo-output value="VICTIM"/></output>
</configuration>"#;

const CAR_ROUTES: &str = r#"<routes>
    <route id="west" edges="e0_r0c1 r0c1_r0c0 r0c0_w0"/>
    <trip id="early" type="car" depart="50" from="w0_r0c0" to="r0c1_e0"/>
    <trip id="t" type="car" depart="120.00" from="w0_r0c0" to="r0c1_e0"/>
    <vehicle id="v" type="car" depart="130" route="west"/>
    <vehicle id="w" depart="00:02:20"><route edges="s0_r0c0 r0c0_r1c0"/></vehicle>
    <flow id="f" type="mixed" begin="150" end="390" period="8" from="n1_r1c1" to="r0c1_s1"/>
</routes>"#;

const BUS_ROUTES: &str = r#"<routes>
    <vType id="bus" vClass="bus" length="12"/>
    <flow id="g" type="bus" begin="110" end="410" vehsPerHour="120" departSpeed="max"><route edges="w1_r1c0 r1c0_r1c1"/></flow>
</routes>"#;

const ADDITIONAL: &str = r#"<additional>
    <vType id="car" sigma="0.5" length="4.3" speedDev="0.1"/>
    <vType id="lorry" vClass="truck" length="9"/>
    <vTypeDistribution id="mixed" vTypes="car lorry" probabilities="3 1"/>
    <inductionLoop id="loop" lane="w0_r0c0_0" pos="50" freq="60" file="VICTIM"/>
    <edgeData id="means" file="VICTIM"/>
</additional>"#;

/// A folder with a scenario on a grid of 2 x 2 lights, and a file of the user outside of it.
struct Room {
    dir: TempDir,
}

impl Room {
    fn new() -> Room {
        let room = Room { dir: tempfile::tempdir().unwrap() };
        let grid = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/grid_2x2.net.xml");
        fs::copy(grid, room.path(NET)).unwrap();
        for (name, text) in [(SUMOCFG, CONFIGURATION), (CARS, CAR_ROUTES), (BUSES, BUS_ROUTES), (MORE, ADDITIONAL)] {
            fs::write(room.path(name), text.replace("VICTIM", room.victim().to_str().unwrap())).unwrap();
        }
        fs::write(room.victim(), "precious").unwrap();
        room
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn victim(&self) -> PathBuf {
        self.path("victim.txt")
    }

    /// Replaces a text in a file once.
    fn change(&self, file: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.path(file)).unwrap();
        assert!(text.contains(from), "{from} is not in {file}");
        fs::write(self.path(file), text.replacen(from, to, 1)).unwrap();
    }

    fn config(&self, settings: &[&str]) -> anyhow::Result<Config> {
        load(&self.path(SUMOCFG), &settings.iter().map(|&setting| setting.to_owned()).collect::<Vec<_>>())
    }

    fn read(&self) -> anyhow::Result<SumoScenario> {
        SumoScenario::read(&table(self.config(&[])?))
    }

    /// Returns an error with `DIR/` for the folder.
    fn error(&self) -> String {
        let error = self.read().expect_err("this scenario is broken");
        format!("{error:#}").replace(&format!("{}/", self.dir.path().display()), "DIR/")
    }
}

fn table(config: Config) -> ScenarioConfig {
    let Some(DomainConfig::Scenario(table)) = config.domain else { panic!("the config is of a scenario") };
    table
}

#[test]
fn a_sumocfg_stands_for_a_config_with_default_settings() {
    let room = Room::new();
    let config = room.config(&["traffic.decision_s=10", "ppo.clip=0.3", "total_steps=40000"]).unwrap();
    assert_eq!((config.simulator, config.horizon()), (Simulator::Global, 30));
    assert_eq!((config.ppo.clip, config.ppo.memory, config.total_steps), (0.3, 240, 40_000));
    let table = table(config);
    assert_eq!((table.scenario, table.begin_s, table.end_s), (room.path(SUMOCFG), Some(100), Some(400)));
}

#[test]
fn a_config_names_a_scenario_beside_it_and_may_narrow_its_time() {
    let room = Room::new();
    fs::write(room.path("c.toml"), "[traffic]\nscenario = 'x.sumocfg'\nend_s = 200\nreward = { queue = 0.5 }\n")
        .unwrap();
    let config = load(&room.path("c.toml"), &[]).unwrap();
    assert_eq!(config.horizon(), 20);
    let kept = dials_traffic::config::to_toml(&config).unwrap();
    fs::write(room.path("kept.toml"), kept).unwrap();
    assert_eq!(load(&room.path("kept.toml"), &[]).unwrap(), config);
    assert_eq!(SumoScenario::read(&table(config)).unwrap().window_s(), (100, 200));
}

#[test]
fn keys_of_the_other_way_are_refused() {
    let room = Room::new();
    for (table, told) in [
        ("horizon = 3", "traffic names nothing to simulate"),
        (
            "scenario = 'x.sumocfg'\nnetwork = 'n'",
            "traffic.network is for a grid, but the table names a .sumocfg by `scenario`; remove one of them",
        ),
        ("scenario = 'x.sumocfg'\nhorizon = 3", "traffic.horizon is for a grid"),
        (
            "network = 'n'\nlocal_network = 'l'\nyellow_s = 4",
            "traffic.yellow_s is for a scenario, but the table names a grid by `network`; remove one of them",
        ),
        ("network = 'n'", "missing field `local_network`: a grid needs `network` and `local_network`"),
        ("scenario = 'x.sumocfg'\nreward = 'money'", "unknown variant `money`"),
        ("scenario = 'x.sumocfg'\nsenario = 'y'", "unknown field `senario`"),
        ("scenario = 'x.sumocfg'\nbegin_s = 500", "traffic.begin_s = 500: must be before traffic.end_s = 400"),
        ("scenario = 'x.sumocfg'\ndecision_s = 301", "traffic.decision_s = 301: must be from 1 to 300 seconds"),
    ] {
        fs::write(room.path("c.toml"), format!("[traffic]\n{table}\n")).unwrap();
        let error = load(&room.path("c.toml"), &[]).unwrap_err().to_string();
        assert!(error.replace(['[', ']'], "").contains(told), "{table}: {error}");
    }
}

#[test]
fn what_is_not_simulated_is_listed() {
    let room = Room::new();
    let dir = room.dir.path().display();
    assert_eq!(
        room.read().unwrap().left_out(),
        [
            "option tripinfo-output: this program writes its own measurements".to_owned(),
            format!("{dir}/more.add.xml: 1 x <edgeData>: this program measures and writes by itself"),
            format!("{dir}/more.add.xml: 1 x <inductionLoop>: this program measures and writes by itself"),
            format!("{dir}/cars.rou.xml: 1 vehicles and flows depart before 100 s or from 400 s on"),
        ]
    );
}

/// A file, a text in it, what takes its place, and the error.
type Break = (&'static str, &'static str, &'static str, &'static str);

/// Ways to break the .sumocfg.
const BROKEN_CONFIGURATIONS: &[Break] = &[
    (
        SUMOCFG,
        "net.net.xml",
        "no.net.xml",
        "DIR/x.sumocfg: <net-file> names DIR/no.net.xml, and there is no such file; correct the path",
    ),
    (
        SUMOCFG,
        "cars.rou.xml",
        "../no.xml",
        "DIR/x.sumocfg: <route-files> names DIR/../no.xml, and there is no such file; correct the path",
    ),
    (
        SUMOCFG,
        "more.add.xml",
        "/no/such.add.xml",
        "DIR/x.sumocfg: <additional-files> names /no/such.add.xml, and there is no such file; correct the path",
    ),
    (SUMOCFG, "cars.rou.xml", "/dev/zero", "/dev/zero: could not be read: it is not a regular file"),
    (SUMOCFG, "<net-file value=\"net.net.xml\"/>", "", "DIR/x.sumocfg: names no net; add <net-file value=\"...\"/>"),
    (
        SUMOCFG,
        "net.net.xml",
        "more.add.xml",
        "DIR/more.add.xml: is no net of SUMO: its root is <additional>, not <net>",
    ),
    (
        SUMOCFG,
        "cars.rou.xml",
        "net.net.xml",
        "DIR/net.net.xml: is a net, and <route-files> of DIR/x.sumocfg names it; correct the path",
    ),
    (
        SUMOCFG,
        "<begin value=\"100\"/>",
        "<begin value=\"400\"/>",
        "DIR/x.sumocfg: <begin value=\"400\">: must be before <end value=\"400\">, so nothing would be simulated",
    ),
    (
        SUMOCFG,
        "<end value=\"400\"/>",
        "<end value=\"noon\"/>",
        "DIR/x.sumocfg: <end>: `noon` is no time: it must be seconds, such as 3600, or 01:00:00",
    ),
    (
        SUMOCFG,
        "<end value=\"400\"/>",
        "",
        "DIR/x.sumocfg: traffic.end_s: is missing here and in the .sumocfg; set it to a second",
    ),
    (
        SUMOCFG,
        "<end value=\"400\"/>",
        "<end value=\"9000000000\"/>",
        "DIR/x.sumocfg: traffic.decision_s = 5: from 100 to 9000000000 s there are 1799999980 decisions, but there must be from 1 to 1000000",
    ),
    (
        SUMOCFG,
        "<time>",
        "<time><step-length value=\"0.5\"/>",
        "DIR/x.sumocfg: <step-length>: is 0.5, and this program simulates steps of 1 s; remove it or set it to 1",
    ),
    (
        SUMOCFG,
        "<processing>",
        "<processing><lateral-resolution value=\"0.8\"/>",
        "DIR/x.sumocfg: <lateral-resolution>: is 0.8, and this program does not know the sublane model, in which cars share a lane; remove it",
    ),
    (
        SUMOCFG,
        "<processing>",
        "<processing><mesosim value=\"true\"/>",
        "DIR/x.sumocfg: <mesosim>: is true, and this program simulates single cars and lanes; remove it",
    ),
    (
        SUMOCFG,
        "<input>",
        "<input><load-state value=\"s.xml\"/>",
        "DIR/x.sumocfg: <load-state>: is s.xml, and it reads a file that this program does not copy into a run directory; remove it",
    ),
    (
        SUMOCFG,
        "<processing>",
        "<processing><frobnicate value=\"1\"/>",
        "DIR/x.sumocfg: <frobnicate>: is no option of SUMO that this program knows; remove it",
    ),
    (
        SUMOCFG,
        "<processing>",
        "<processing><eager-insert value=\"--tripinfo-output=VICTIM\"/>",
        "DIR/x.sumocfg: <eager-insert>: is `--tripinfo-output=VICTIM`, which is no value of it; remove it",
    ),
    (SUMOCFG, "<time>", "<time><begin value=\"7\"/>", "DIR/x.sumocfg: <begin>: is given twice; remove one of them"),
    (SUMOCFG, "</configuration>", "", "DIR/x.sumocfg: is not XML: the root node was opened but never closed"),
    (
        SUMOCFG,
        "<configuration>",
        "<!DOCTYPE x [<!ENTITY y SYSTEM '/etc/passwd'>]><configuration>",
        "DIR/x.sumocfg: has a document type (<!DOCTYPE ...>), which SUMO's files do not need",
    ),
];

/// Ways to break the net.
const BROKEN_NETS: &[Break] = &[
    (
        NET,
        "<edge id=\"e0_r0c1\"",
        "<edge id=\"e1_r1c1\"",
        "DIR/net.net.xml: <edge id=\"e1_r1c1\">: stands twice; remove one of them",
    ),
    (
        NET,
        "<connection from=\"e0_r0c1\"",
        "<connection from=\"no\"",
        "DIR/net.net.xml: <connection>: from=\"no\": the net has no such edge",
    ),
    (
        NET,
        "tl=\"r0c1\"",
        "tl=\"no\"",
        "DIR/net.net.xml: <connection>: tl=\"no\": there is no light (<tlLogic>) of this id",
    ),
    (
        NET,
        "fromLane=\"0\"",
        "fromLane=\"7\"",
        "DIR/net.net.xml: <connection>: fromLane=\"7\": edge e0_r0c1 has no such lane",
    ),
    (
        NET,
        "<tlLogic id=\"r0c0\" type=\"static\"",
        "<tlLogic id=\"r0c0\" type=\"rail_crossing\"",
        "DIR/net.net.xml: <tlLogic id=\"r0c0\">: type=\"rail_crossing\": this program does not simulate trains; remove the track from the net",
    ),
    (
        NET,
        "</net>",
        "<busStop id=\"s\" lane=\"w0_r0c0_0\"/></net>",
        "DIR/net.net.xml: <busStop id=\"s\">: this program does not simulate stops; remove it",
    ),
    (NET, "</net>", "<frob/></net>", "DIR/net.net.xml: <frob>: is no element that this program knows here; remove it"),
];

/// Ways to break the demand.
const BROKEN_DEMANDS: &[Break] = &[
    (
        CARS,
        "from=\"w0_r0c0\"",
        "from=\"no\"",
        "DIR/cars.rou.xml: <trip id=\"early\">: from=\"no\": the net has no such edge; correct it or remove the element",
    ),
    (CARS, "r0c1_r0c0 r0c0_w0", "no r0c0_w0", "DIR/cars.rou.xml: <route id=\"west\">: edges: the net has no edge no"),
    (
        CARS,
        "edges=\"s0_r0c0 r0c0_r1c0\"",
        "edges=\"s0_r0c0 e0_r0c1\"",
        "DIR/cars.rou.xml: <vehicle id=\"w\">: its route goes from edge s0_r0c0 to edge e0_r0c1, and the net has no such connection for the class passenger; correct the route",
    ),
    (
        CARS,
        "from=\"n1_r1c1\" to=\"r0c1_s1\"",
        "from=\"n1_r1c1\" to=\"r0c0_w0\"",
        "DIR/cars.rou.xml: <flow id=\"f\">: there is no way from edge n1_r1c1 to edge r0c0_w0; correct the trip",
    ),
    (
        CARS,
        "route=\"west\"",
        "route=\"east\"",
        "DIR/cars.rou.xml: <vehicle id=\"v\">: route=\"east\": no route of this id is defined before it; define it or correct the id",
    ),
    (
        CARS,
        "type=\"mixed\"",
        "type=\"bus\"",
        "DIR/cars.rou.xml: <flow id=\"f\">: type=\"bus\": no type of this id is defined before it; define it in this file or an additional file",
    ),
    (
        CARS,
        "id=\"v\"",
        "id=\"t\"",
        "DIR/cars.rou.xml: <vehicle id=\"t\">: a vehicle, trip or flow of this id is defined twice; rename one of them",
    ),
    (
        BUSES,
        "id=\"g\"",
        "id=\"f\"",
        "DIR/buses.rou.xml: <flow id=\"f\">: a vehicle, trip or flow of this id is defined twice; rename one of them",
    ),
    (
        BUSES,
        "id=\"bus\"",
        "id=\"car\"",
        "DIR/buses.rou.xml: <vType id=\"car\">: a type of this id is defined twice; remove one of them",
    ),
    (
        CARS,
        "<trip id=\"early\"",
        "<route id=\"west\" edges=\"e0_r0c1\"/><trip id=\"early\"",
        "DIR/cars.rou.xml: <route id=\"west\">: a route of this id is defined twice; remove one of them",
    ),
    (
        CARS,
        "depart=\"120.00\"",
        "depart=\"later\"",
        "DIR/cars.rou.xml: <trip id=\"t\">: depart: `later` is no time: it must be seconds, such as 3600, or 01:00:00",
    ),
    (CARS, "depart=\"120.00\"", "", "DIR/cars.rou.xml: <trip id=\"t\">: has no depart; add the attribute"),
    (
        CARS,
        "depart=\"120.00\"",
        "depart=\"triggered\"",
        "DIR/cars.rou.xml: <trip id=\"t\">: depart=\"triggered\": this program does not simulate persons and trains; set a second",
    ),
    (
        CARS,
        "depart=\"120.00\"",
        "depart=\"140.00\"",
        "DIR/cars.rou.xml: <vehicle id=\"v\">: depart=\"130\": comes after one that departs at 140 s, and SUMO would leave it out; sort the file by departure",
    ),
    (
        CARS,
        "route=\"west\"",
        "",
        "DIR/cars.rou.xml: <vehicle id=\"v\">: has no way to go: it needs a route; add it or remove the element",
    ),
    (
        CARS,
        "period=\"8\"",
        "",
        "DIR/cars.rou.xml: <flow id=\"f\">: has none of number, period, vehsPerHour, perHour and probability; add one",
    ),
    (
        CARS,
        "period=\"8\"",
        "probability=\"8\"",
        "DIR/cars.rou.xml: <flow id=\"f\">: probability=\"8\": must be from 0 to 1; correct it",
    ),
    (
        CARS,
        "period=\"8\"",
        "number=\"1e99\"",
        "DIR/cars.rou.xml: <flow id=\"f\">: number=\"1e99\": must be from 0 to 10000000; correct it",
    ),
    (CARS, "period=\"8\"", "period=\"often\"", "DIR/cars.rou.xml: <flow id=\"f\">: period=\"often\": is no number"),
    (
        CARS,
        "end=\"390\"",
        "end=\"149\"",
        "DIR/cars.rou.xml: <flow id=\"f\">: end=\"149\": is before its begin, 150 s; correct one of them",
    ),
    (
        CARS,
        "route=\"west\"/>",
        "route=\"west\"><stop lane=\"r0c0_w0_0\" duration=\"9\"/></vehicle>",
        "DIR/cars.rou.xml: <stop> in <vehicle id=\"v\">: this program does not simulate stops; remove it",
    ),
    (
        CARS,
        "</routes>",
        "<person id=\"p\" depart=\"150\"><walk edges=\"w0_r0c0\"/></person></routes>",
        "DIR/cars.rou.xml: <person id=\"p\">: this program does not simulate persons; remove it",
    ),
    (
        CARS,
        "</routes>",
        "<trp id=\"p\" depart=\"150\"/></routes>",
        "DIR/cars.rou.xml: <trp id=\"p\">: is no element that this program knows here; remove it",
    ),
    (
        BUSES,
        "vClass=\"bus\"",
        "vClass=\"tram\"",
        "DIR/buses.rou.xml: <flow id=\"g\">: type=\"bus\": its class is tram, and this program simulates roads; remove it",
    ),
    (
        BUSES,
        "length=\"12\"",
        "length=\"12000\"",
        "DIR/buses.rou.xml: <vType id=\"bus\">: length=\"12000\": must be from 0.1 to 200; correct it",
    ),
    (
        MORE,
        "vTypes=\"car lorry\"",
        "vTypes=\"car ship\"",
        "DIR/more.add.xml: <vTypeDistribution id=\"mixed\">: vTypes: no type ship is defined before it",
    ),
    (
        MORE,
        "</additional>",
        "<rerouter id=\"r\" edges=\"w0_r0c0\" file=\"VICTIM\"/></additional>",
        "DIR/more.add.xml: <rerouter id=\"r\">: this program does not simulate rerouters; remove it",
    ),
    (
        MORE,
        "</additional>",
        "<include href=\"VICTIM\"/></additional>",
        "DIR/more.add.xml: <include>: is no element that this program knows here; remove it",
    ),
    (
        MORE,
        "length=\"4.3\" speedDev=\"0.1\"/>",
        "length=\"4.3\"><param key=\"device.ssm.file\" value=\"VICTIM\"/></vType>",
        "DIR/more.add.xml: has <param key=\"device.ssm.file\">, by which SUMO writes another file; remove it",
    ),
    (
        MORE,
        "</additional>",
        "<tlLogic id=\"r0c0\" type=\"actuated\" programID=\"1\"><phase duration=\"9\" state=\"GGGG\"/><param key=\"w0_r0c0_0\" value=\"loop\"/></tlLogic></additional>",
        "DIR/more.add.xml: <tlLogic id=\"r0c0\">: asks the detector loop, and this program leaves detectors out; remove the parameter, and SUMO places detectors of its own",
    ),
];

#[test]
fn every_broken_scenario_gets_one_clear_error() {
    let breaks = || [BROKEN_CONFIGURATIONS, BROKEN_NETS, BROKEN_DEMANDS].concat();
    assert!(breaks().len() >= 50);
    for (file, from, to, told) in breaks() {
        let room = Room::new();
        let victim = room.victim().display().to_string();
        room.change(file, from, &to.replace("VICTIM", &victim));
        let before = names(room.dir.path());
        assert_eq!(
            room.error(),
            told.replace("VICTIM", &victim).replace(&format!("{}/", room.dir.path().display()), "DIR/")
        );
        assert_eq!(
            (names(room.dir.path()), fs::read_to_string(room.victim()).unwrap()),
            (before, "precious".to_owned())
        );
    }
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

/// Returns the names in a folder, sorted.
fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.collect();
    names.sort();
    names
}

#[test]
fn a_copy_holds_plain_names_and_is_the_same_scenario() {
    let room = Room::new();
    fs::create_dir(room.path("deep")).unwrap();
    fs::rename(room.path(CARS), room.path("deep/my cars.xml")).unwrap();
    room.change(SUMOCFG, "cars.rou.xml", &room.path("deep/../deep/my%20cars.xml").display().to_string());
    fs::write(room.path("overrides.toml"), "# nothing yet\n").unwrap();
    let config = room.config(&["traffic.agents=overrides.toml"]).unwrap();
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
    assert_eq!(copy.left_out().len(), 1, "a vehicle departs too early: {:?}", copy.left_out());
    copy.keep_in(&room.path("again")).unwrap();
    for name in expected {
        let [first, second] = ["run", "again"].map(|dir| fs::read(room.path(dir).join(name)).unwrap());
        assert!(first == second, "{name} of a copy of a copy differs");
    }
    let folder_is_taken = copy.keep_in(&room.path("again")).unwrap_err().to_string();
    assert!(folder_is_taken.ends_with("again: cannot be made"));
}

#[test]
fn the_checksum_changes_with_everything_that_decides_what_returns_mean() {
    let room = Room::new();
    let original = room.read().unwrap().checksum();
    let with = |setting: &str| SumoScenario::read(&table(room.config(&[setting]).unwrap())).unwrap().checksum();
    for setting in ["traffic.decision_s=6", "traffic.yellow_s=4", "traffic.reward=queue", "traffic.end_s=390"] {
        assert_ne!(with(setting), original, "{setting}");
    }
    for setting in ["traffic.observation=queues", "traffic.reward=wait", "traffic.begin_s=100", "seed=9"] {
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
    let loadable = scenario.for_sumo().unwrap();
    let options = loadable.options(42, &[]);
    let mut simulation = Simulation::load(&options).map_err(|error| loadable.explain(&error)).unwrap();
    assert_eq!(simulation.time_s().unwrap(), 100.0);
    let mut departed = 0;
    for _ in 100..400 {
        simulation.step().unwrap();
        departed += simulation.departures().unwrap().len();
    }
    drop(simulation);

    let output = Command::new("sumo")
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

#[test]
fn a_broken_scenario_ends_a_command_before_it_writes_anything() {
    let room = Room::new();
    room.change(CARS, "from=\"w0_r0c0\"", "from=\"no\"");
    fs::create_dir(room.path("here")).unwrap();
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    let output = command.args(["train", "../x.sumocfg"]).current_dir(room.path("here")).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("../cars.rou.xml: <trip id=\"early\">: from=\"no\": the net has no such edge"), "{said}");
    assert_eq!(names(&room.path("here")), [""; 0]);
}

/// SUMO lists its options itself. A .sumocfg may set any of them, and this program has an answer to each.
#[test]
fn every_option_of_sumo_is_known() {
    let help = Command::new("sumo").arg("--help").output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let long = |line: &str| {
        let (_, rest) = line.split_at_checked(2)?;
        let name = rest.split_once("--")?.1;
        Some(name.split_whitespace().next()?.to_owned())
    };
    let options: Vec<String> = help.lines().filter(|line| line.starts_with("  -")).filter_map(long).collect();
    assert!(options.len() > 300, "{}", options.len());
    let of_the_command_line = [
        "configuration-file",
        "save-configuration",
        "save-template",
        "save-schema",
        "save-commented",
        "help",
        "version",
    ];
    for option in options.iter().filter(|option| !of_the_command_line.iter().any(|other| option.starts_with(other))) {
        let room = Room::new();
        room.change(SUMOCFG, "<processing>", &format!("<processing><{option} value=\"7\"/>"));
        let known = room.config(&[]).map_or_else(|error| format!("{error:#}"), |_| String::new());
        assert!(!known.contains("no option of SUMO that this program knows"), "{option}: {known}");
    }
}

/// Real maps, where somebody has them: the variable names their folder.
#[test]
fn real_maps_are_read() {
    let Some(folder) = std::env::var_os("DIALS_NETWORKS").map(PathBuf::from) else {
        eprintln!("skipped: DIALS_NETWORKS names no folder with real maps");
        return;
    };
    for (map, begin) in
        [("cologne1", 25_200), ("cologne3", 25_200), ("ingolstadt1", 57_600), ("ingolstadt7", 57_600), ("grid4x4", 0)]
    {
        let config = load(&folder.join(format!("{map}/{map}.sumocfg")), &[]).unwrap();
        assert_eq!(config.horizon(), 720, "{map}");
        let scenario = SumoScenario::read(&table(config)).unwrap();
        assert_eq!(scenario.window_s(), (begin, begin + 3600), "{map}");
    }
}
