//! What scenarios of others have, and what becomes of it: the whole network plays it as SUMO does, and local simulators do
//! without, or are refused.

use std::fs;

use dials_core::base::{AgentId, Seed};
use dials_core::domain::{Domain, GlobalSimulator, LocalSimulator, Measures};
use dials_traffic::Traffic;
use dials_traffic::controllers::HandCoded;
use dials_traffic::fidelity::Fidelity;
use dials_traffic::fidelity::truth::Truth;
use dials_traffic::sim::control::SignalControl;

use super::room::{BUSES, CARS, MORE, NET, Room, SUMOCFG, names, table};

/// A file, a text in it, and what takes its place.
type Change = (&'static str, &'static str, &'static str);

/// What a note is about.
#[derive(Clone, Copy, Debug, PartialEq)]
enum About {
    LeftOut,
    WithoutLocally,
    NotLocal,
    Nothing,
}

use About::{LeftOut, NotLocal, Nothing, WithoutLocally};

const ADMITTED: &[(Change, About, &str)] = &[
    ((SUMOCFG, "<time>", "<time><step-length value=\"0.25\"/>"), Nothing, ""),
    ((SUMOCFG, "<processing>", "<processing><max-depart-delay value=\"5\"/>"), Nothing, ""),
    ((SUMOCFG, "<processing>", "<processing><time-to-teleport.remove value=\"true\"/>"), Nothing, ""),
    (
        (SUMOCFG, "<processing>", "<processing><lateral-resolution value=\"0.8\"/>"),
        NotLocal,
        "option lateral-resolution: cars share a lane",
    ),
    (
        (SUMOCFG, "<processing>", "<processing><lanechange.duration value=\"3\"/>"),
        NotLocal,
        "option lanechange.duration: cars can be between two lanes",
    ),
    (
        (SUMOCFG, "<processing>", "<processing><mesosim value=\"true\"/>"),
        LeftOut,
        "option mesosim: this program simulates single cars on lanes",
    ),
    (
        (SUMOCFG, "<processing>", "<processing><device.glosa.probability value=\"1\"/>"),
        WithoutLocally,
        "option device.glosa.probability: its cars drive like all others",
    ),
    ((NET, "</net>", "<busStop id=\"s\" lane=\"w0_r0c0_0\" startPos=\"20\" endPos=\"40\"/></net>"), Nothing, ""),
    ((CARS, "route=\"west\"/>", "route=\"west\"><stop lane=\"r0c0_w0_0\" duration=\"9\"/></vehicle>"), Nothing, ""),
    (
        (CARS, "route=\"west\"/>", "route=\"west\"><stop lane=\"r0c0_w0_0\" until=\"200\"/></vehicle>"),
        WithoutLocally,
        "stops without a duration (1): vehicles do not stop there",
    ),
    (
        (CARS, "</routes>", "<person id=\"p\" depart=\"395\"><walk edges=\"w0_r0c0\"/></person></routes>"),
        WithoutLocally,
        "persons (1): nobody is on foot",
    ),
    (
        (
            CARS,
            "</routes>",
            "<containerFlow id=\"p\" begin=\"395\" end=\"399\" number=\"2\"><tranship from=\"w0_r0c0\" to=\"w0_r0c0\" departPos=\"0\" arrivalPos=\"9\"/></containerFlow></routes>",
        ),
        WithoutLocally,
        "flows of containers (1): nobody is on foot",
    ),
    (
        (BUSES, "<vType id=\"bus\" vClass=\"bus\"", "<vType id=\"bus\" vClass=\"tram\""),
        WithoutLocally,
        "vehicles of class tram (10): only those in lanes for cars are there",
    ),
    (
        (CARS, "depart=\"120.00\"", "depart=\"140.00\""),
        LeftOut,
        "cars.rou.xml: 1 of its vehicles and flows come after one that departs later, such as <vehicle id=\"v\">",
    ),
    (
        (CARS, "</routes>", "<trp id=\"p\" depart=\"150\"/></routes>"),
        LeftOut,
        "1 x <trp>: SUMO does not know this element",
    ),
    (
        (CARS, "</routes>", "<taz id=\"z\" edges=\"w0_r0c0\"/></routes>"),
        LeftOut,
        "1 x <taz>: SUMO skips it in a route file; move it to an additional file",
    ),
    (
        (
            MORE,
            "length=\"4.3\" speedDev=\"0.1\"/>",
            "length=\"4.3\"><param key=\"device.ssm.file\" value=\"VICTIM\"/></vType>",
        ),
        LeftOut,
        "1 x <param key=\"device.ssm.file\">: this program measures and writes by itself",
    ),
    (
        (MORE, "length=\"4.3\"", "length=\"4.3\" imgFile=\"VICTIM\" emissionClass=\"PHEMlight/PKW_G_EU4\""),
        LeftOut,
        "1 x imgFile of <vType>: it is only for pictures, or for outputs",
    ),
    (
        (
            MORE,
            "</additional>",
            "<tlLogic id=\"r0c0\" type=\"actuated\" programID=\"1\"><phase duration=\"9\" minDur=\"9\" maxDur=\"9\" state=\"GGGG\"/><phase duration=\"9\" minDur=\"9\" maxDur=\"9\" state=\"GrGr\"/><param key=\"w0_r0c0_0\" value=\"loop\"/></tlLogic></additional>",
        ),
        Nothing,
        "",
    ),
    (
        (
            MORE,
            "</additional>",
            "<rerouter id=\"r\" edges=\"w0_r0c0\"><interval begin=\"0\" end=\"999\"><closingReroute id=\"r1c0_w1\"/></interval></rerouter></additional>",
        ),
        WithoutLocally,
        "closed roads (1): no road is closed",
    ),
    (
        (
            MORE,
            "</additional>",
            "<variableSpeedSign id=\"s\" lanes=\"w0_r0c0_0\"><step time=\"200\" speed=\"3\"/></variableSpeedSign></additional>",
        ),
        WithoutLocally,
        "signs of a speed limit (1): speed limits stay as they are",
    ),
    (
        (
            MORE,
            "</additional>",
            "<calibrator id=\"c\" edge=\"w0_r0c0\" pos=\"0\" output=\"VICTIM\"><flow begin=\"100\" end=\"400\" route=\"in\" vehsPerHour=\"600\" speed=\"9\"/><route id=\"in\" edges=\"w0_r0c0 r0c0_r0c1\"/></calibrator></additional>",
        ),
        LeftOut,
        "1 x output of <calibrator>: it is only for pictures, or for outputs",
    ),
    (
        (
            MORE,
            "</additional>",
            "<poly id=\"p\" shape=\"0,0 1,1 2,0\"><timedEvent type=\"SaveTLSStates\" source=\"r0c0\" dest=\"VICTIM\"/></poly></additional>",
        ),
        LeftOut,
        "1 x <timedEvent>: this program measures and writes by itself",
    ),
    (
        (
            MORE,
            "</additional>",
            "<tlLogic id=\"r0c0\" type=\"actuated\" programID=\"1\"><condition id=\"C\" value=\"z:loop &gt; 3\"/><phase duration=\"9\" minDur=\"9\" maxDur=\"9\" state=\"GGGG\" finalTarget=\"C\"/><phase duration=\"9\" minDur=\"9\" maxDur=\"9\" state=\"GrGr\"/></tlLogic></additional>",
        ),
        Nothing,
        "",
    ),
    ((CARS, "<vehicle id=\"v\"", "<vehicle id=\"v\" departEdge=\"1\""), Nothing, ""),
    (
        (
            CARS,
            "<flow id=\"f\" type=\"mixed\" begin=\"150\" end=\"390\" period=\"8\" from=\"n1_r1c1\" to=\"r0c1_s1\"/>",
            "<interval begin=\"150\" end=\"390\"><flow id=\"f\" number=\"30\" from=\"n1_r1c1\" to=\"r0c1_s1\"/></interval>",
        ),
        Nothing,
        "",
    ),
    (
        (
            BUSES,
            "<vType id=\"bus\" vClass=\"bus\" length=\"12\"/>",
            "<vType id=\"bus\" vClass=\"emergency\"><param key=\"has.bluelight.device\" value=\"true\"/></vType>",
        ),
        WithoutLocally,
        "parameters has.bluelight.device (1): its cars drive like all others",
    ),
];

fn opened(room: &Room) -> Traffic {
    Traffic::open_scenario(&table(room.config(&[]).unwrap())).unwrap()
}

/// Plays a whole episode. Returns its measures.
fn played(traffic: &Traffic) -> Measures {
    let mut gs = traffic.global(traffic.everywhere(HandCoded::OwnProgram)).unwrap();
    gs.measure_in_full().unwrap();
    gs.reset(Seed::new(3)).unwrap();
    for _ in 0..traffic.kinds().horizon() {
        gs.step(&vec![0; traffic.agents()]).unwrap();
    }
    gs.measures().unwrap()
}

fn measure(measures: &Measures, name: &str) -> f64 {
    measures.system.iter().find(|(other, _)| other == name).unwrap_or_else(|| panic!("no {name}")).1
}

#[test]
fn the_whole_network_plays_what_sumo_plays_and_local_simulators_say_what_they_lack() {
    for &((file, from, to), about, note) in ADMITTED {
        let room = Room::new();
        room.change(file, from, &to.replace("VICTIM", room.victim().to_str().unwrap()));
        let before = names(room.dir.path());
        let scenario = room.read().unwrap();
        let notes = scenario.notes();
        for (kind, list) in
            [(LeftOut, &notes.left_out), (WithoutLocally, &notes.without_locally), (NotLocal, &notes.not_local)]
        {
            assert_eq!(list.iter().any(|has| !note.is_empty() && has.contains(note)), kind == about, "{to}: {list:?}");
        }
        let traffic = opened(&room);
        assert!(measure(&played(&traffic), "departed") > 10.0, "{to}");
        let local = traffic.try_local();
        assert_eq!(local.is_err(), about == NotLocal, "{to}: {local:?}");
        assert_eq!(names(room.dir.path()), before, "{to}");
        assert_eq!(fs::read_to_string(room.victim()).unwrap(), "precious", "{to}");
    }
}

#[test]
fn a_step_of_sumo_may_be_a_part_of_a_second() {
    let room = Room::new();
    let whole = played(&opened(&room));
    room.change(SUMOCFG, "<time>", "<time><step-length value=\"0.5\"/>");
    let half = played(&opened(&room));
    for name in ["departed", "arrived"] {
        let [whole, half] = [&whole, &half].map(|measures| measure(measures, name));
        assert!((whole - half).abs() <= 3.0, "{name}: {whole} and {half}");
    }
    let control = SignalControl::Agents;
    let traffic = opened(&room);
    let mut gs = traffic.global(control).unwrap();
    gs.reset(Seed::new(3)).unwrap();
    drop(gs);
    traffic.try_local().unwrap();
}

#[test]
fn a_net_without_internal_lanes_plays_and_has_no_local_simulators() {
    let room = Room::new();
    let net = fs::read_to_string(room.path(NET)).unwrap();
    let lines: Vec<&str> = net.lines().collect();
    // Without the edges within junctions, and without the names of their lanes.
    let (mut kept, mut inside) = (String::new(), false);
    for line in lines {
        inside |= line.contains("function=\"internal\"");
        if !inside && !line.contains("type=\"internal\"") && !line.contains("from=\":") {
            let line = without(line, " via=\"");
            kept += &without(&line, " intLanes=\"")
                .replace(" type=\"traffic_light\"", " intLanes=\"\" type=\"traffic_light\"");
            kept.push('\n');
        }
        inside &= !line.contains("</edge>");
    }
    fs::write(room.path(NET), kept).unwrap();
    let traffic = opened(&room);
    assert!(measure(&played(&traffic), "departed") > 10.0);
    let error = traffic.try_local().unwrap_err().to_string();
    assert!(error.contains("its net has no internal lanes, so cars jump over intersections"), "{error}");
    assert!(error.contains("train on the whole network (--simulator gs)"), "{error}");
}

/// Returns a line without an attribute. `begin`: the beginning of the attribute up to its value.
fn without(line: &str, begin: &str) -> String {
    let Some((before, rest)) = line.split_once(begin) else { return line.to_owned() };
    let (_, after) = rest.split_once('"').unwrap();
    format!("{before}{after}")
}

/// Writes a scenario with sidewalks, crossings, buses and persons into a folder.
fn write_street(dir: &std::path::Path) -> std::path::PathBuf {
    let net = dir.join("street.net.xml");
    let netgenerate = dials_traffic::sumo_program("netgenerate").expect("it comes with SUMO");
    let made = std::process::Command::new(netgenerate)
        .args(["--grid", "--grid.x-number", "2", "--grid.y-number", "1", "--grid.length", "150"])
        .args(["--grid.attach-length", "150", "-j", "traffic_light", "--sidewalks.guess", "--crossings.guess"])
        .args(["--no-turnarounds", "-o", net.to_str().unwrap()])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let routes = r#"<routes>
        <vType id="line" vClass="bus"/>
        <flow id="bus" type="line" begin="0" end="300" period="20" from="left0A0" to="B0right0"/>
        <flow id="car" begin="0" end="300" period="5" from="left0A0" to="B0right0"/>
        <personFlow id="walk" begin="0" end="300" period="4"><personTrip from="top0A0" to="A0bottom0"/></personFlow>
        <personFlow id="across" begin="0" end="300" period="4"><personTrip from="left0A0" to="B0right0"/></personFlow>
    </routes>"#;
    fs::write(dir.join("street.rou.xml"), routes).unwrap();
    let sumocfg = "<configuration><net-file value='street.net.xml'/><route-files value='street.rou.xml'/><end value='300'/>\
                   </configuration>";
    fs::write(dir.join("street.sumocfg"), sumocfg).unwrap();
    dir.join("street.sumocfg")
}

#[test]
fn any_light_sees_people_and_lets_them_walk_before_they_have_waited_too_long() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = write_street(dir.path());
    let settings = vec!["traffic.observation='lanes'".to_owned()];
    let traffic = Traffic::open_scenario(&table(dials_session::config::load(&scenario, &settings).unwrap())).unwrap();
    let names = traffic.plans()[0].columns();
    let waiting: Vec<usize> =
        (0..names.len()).filter(|&column| names[column].contains("people who wait to walk")).collect();
    assert!(!waiting.is_empty(), "{names:?}");
    // Cars come from the west only, so nothing else ends a green that holds up those who walk from north to south.
    let play = |longest_red_s: u32| {
        let by = traffic.hand_coded(&format!("any-light:longest-red={longest_red_s}")).unwrap();
        let agents = AgentId::all(traffic.agents());
        let mut gs = traffic.global(SignalControl::HandCoded { by, agents }).unwrap();
        gs.measure_in_full().unwrap();
        gs.reset(Seed::new(1)).unwrap();
        let mut most = 0.0_f32;
        for _ in 0..60 {
            let now = gs.step(&vec![0; traffic.agents()]).unwrap();
            most = waiting.iter().map(|&column| now.percept.obs.row(0)[column]).fold(most, f32::max);
        }
        let measures = gs.measures().unwrap();
        (most, measure(&measures, "person_wait_s"))
    };
    let [(most, soon_s), (_, late_s)] = [play(20), play(3_600)];
    assert!(most > 0.2, "{most}");
    assert!(soon_s < 0.8 * late_s, "{soon_s} {late_s}");
}

#[test]
fn agents_see_buses_and_persons_and_are_paid_for_them() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = write_street(dir.path());
    let settings = ["observation='cells+buses'", "reward={'bus-delay'=1.0, 'person-wait'=1.0}"];
    let settings: Vec<String> = settings.iter().map(|setting| format!("traffic.{setting}")).collect();
    let table = table(dials_session::config::load(&scenario, &settings).unwrap());
    let traffic = Traffic::open_scenario(&table).unwrap();
    let names = traffic.plans()[0].columns();
    let of = |what: &str| -> Vec<usize> {
        names.iter().enumerate().filter(|(_, name)| name.starts_with(what)).map(|(column, _)| column).collect()
    };
    let (buses, persons) = (of("buses "), of("persons "));
    assert_eq!((names.len(), persons.len()), (traffic.plans()[0].width(), 4), "{names:?}");
    let mut gs = traffic.global(SignalControl::Agents).unwrap();
    gs.measure_in_full().unwrap();
    gs.reset(Seed::new(1)).unwrap();
    let mut most = [0.0_f32; 3];
    for _ in 0..60 {
        let now = gs.step(&vec![0; traffic.agents()]).unwrap();
        let seen = |columns: &[usize]| -> f32 { columns.iter().map(|&column| now.percept.obs.row(0)[column]).sum() };
        let (buses, persons) = (seen(&buses), seen(&persons));
        // A bus loses at most a second in a second.
        assert!(
            now.rewards[0] <= -persons && now.rewards[0] >= -persons - buses,
            "{} {persons} {buses}",
            now.rewards[0]
        );
        for (most, now) in most.iter_mut().zip([buses, persons, -now.rewards[0]]) {
            *most = most.max(now);
        }
    }
    assert!(most.iter().all(|most| *most > 0.2), "{most:?}");
    let measures = gs.measures().unwrap();
    drop(gs);
    assert!(measure(&measures, "person_wait_s") > 1.0 && measure(&measures, "persons") > 100.0);
    assert!(measure(&measures, "delay_s_bus") > 0.0 && measure(&measures, "delay_s_passenger") > 0.0);
    // A local simulator has buses.
    let mut ls = traffic.local(1).unwrap();
    ls.reset(&dials_core::domain::Beginning::first([0])).unwrap();
    let sources = ls.spec().sources.count();
    let all = dials_core::base::Rows::from_vec(vec![1; sources], sources);
    let mut seen = 0.0;
    for _ in 0..20 {
        let now = ls.step(&[0], &all).unwrap();
        seen += buses.iter().map(|&column| now.percept.obs.row(0)[column]).sum::<f32>();
        assert!(persons.iter().all(|&column| now.percept.obs.row(0)[column] == 0.0));
    }
    assert!(seen > 0.0);
}

#[test]
fn a_program_can_be_chosen_and_the_others_are_named() {
    let room = Room::new();
    let night = |light: &str, state: &str| {
        format!(
            "<tlLogic id=\"{light}\" type=\"static\" programID=\"night\"><phase duration=\"60\" state=\"{state}\"/></tlLogic>"
        )
    };
    let programs = night("r0c0", "oooo") + "</additional>";
    room.change(MORE, "</additional>", &programs);
    let greens = |settings: &[&str]| -> Vec<usize> {
        let traffic = Traffic::open_scenario(&table(room.config(settings).unwrap())).unwrap();
        traffic.plans().iter().map(|plan| plan.phases.greens().len()).collect()
    };
    // Without a green, the first light keeps its program.
    assert_eq!(greens(&[]), [2; 3]);
    assert_eq!(greens(&["traffic.program='0'"]), [2; 4]);
    let warnings = opened(&room).warnings();
    assert!(warnings[0].starts_with("light `r0c0` has 2 programs (0, night): `night` counts"), "{warnings:?}");
    let unknown = table(room.config(&["traffic.program='noon'"]).unwrap());
    let error = Traffic::open_scenario(&unknown).err().unwrap().to_string();
    assert!(error.ends_with(
        "no light has a program of the name `noon`; leave it out, and the last program of each light counts"
    ));
    fs::write(room.path("agents.toml"), "[light.r0c0]\nprogram = \"0\"\n").unwrap();
    assert_eq!(greens(&[&format!("traffic.agents='{}'", room.path("agents.toml").display())]), [2; 4]);
    // SUMO runs it, too.
    let table = table(room.config(&["traffic.program='0'"]).unwrap());
    let chosen = played(&Traffic::open_scenario(&table).unwrap());
    assert_eq!(measure(&chosen, "delay_s"), measure(&played(&opened(&Room::new())), "delay_s"));
}

#[test]
fn a_light_that_a_waut_switches_keeps_its_programs_and_one_that_is_off_stays_off() {
    let room = Room::new();
    let switched = "<tlLogic id=\"r0c0\" type=\"static\" programID=\"day\"><phase duration=\"30\" state=\"GrGr\"/><phase duration=\"30\" \
                    state=\"rGrG\"/></tlLogic><WAUT id=\"w\" refTime=\"0\" startProg=\"0\"><wautSwitch time=\"200\" to=\"day\"/>\
                    </WAUT><wautJunction wautID=\"w\" junctionID=\"r0c0\"/><tlLogic id=\"r1c1\" type=\"off\" programID=\"off\"/>\
                    </additional>";
    room.change(MORE, "</additional>", switched);
    let traffic = opened(&room);
    let lights: Vec<&str> = traffic.plans().iter().map(|plan| &*plan.light).collect();
    assert_eq!(lights, ["r0c1", "r1c0"]);
    let why = traffic.left_out().join("\n");
    assert!(why.contains("light `r0c0` keeps its program: a <WAUT> switches its programs at set times"), "{why}");
    assert!(why.contains("light `r1c1` keeps its program: its program is of type `off`"), "{why}");
    assert!(measure(&played(&traffic), "departed") > 10.0);
}

#[test]
fn greens_last_as_long_as_the_program_says_unless_somebody_says_otherwise() {
    let room = Room::new();
    room.change(NET, "state=\"GrGr\"", "minDur=\"11.5\" maxDur=\"40\" state=\"GrGr\"");
    let least = |settings: &[&str]| {
        let traffic = Traffic::open_scenario(&table(room.config(settings).unwrap())).unwrap();
        traffic.plans()[0].phases.min_green_steps().to_vec()
    };
    assert_eq!(least(&[]), [12, 5]);
    assert_eq!(least(&["traffic.program_min_green=false"]), [5, 5]);
}

#[test]
fn vehicles_stop_in_a_local_simulator_as_in_the_whole_network() {
    let room = Room::new();
    let stop = "<stop lane=\"w1_r1c0_0\" endPos=\"60\" duration=\"25\"/></route>";
    room.change(BUSES, "<route edges=\"w1_r1c0 r1c0_r1c1\"/>", &format!("<route edges=\"w1_r1c0 r1c0_r1c1\">{stop}"));
    let traffic = Traffic::open_dawdling(&table(room.config(&[]).unwrap()), 0.0).unwrap();
    let light = traffic.plans().iter().position(|plan| plan.light == "r1c0").unwrap();
    let truth = Truth::play(&traffic, 300, Seed::new(2)).unwrap();
    let found = Fidelity::new(&traffic, &truth, 100..300).unwrap().measure(AgentId(light)).unwrap();
    let [gs, ls] = found.true_entries.sums;
    // Every 30 s a bus stands for 25 s.
    assert!(gs.mean_speed_mps() < 5.0, "{}", gs.mean_speed_mps());
    assert!((gs.mean_speed_mps() - ls.mean_speed_mps()).abs() < 0.3, "{} {}", gs.mean_speed_mps(), ls.mean_speed_mps());
    let cells = found.sampled_entries.cells;
    assert!(cells.precision() > 0.8 && cells.recall() > 0.8, "{cells:?}");
}
