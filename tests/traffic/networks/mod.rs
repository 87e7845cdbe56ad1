//! The networks against SUMO itself: the files in `sumo_nets/`, the files that the code makes, and forests.
//! `shipped` has the scenarios of `sumo_nets/` that the code does not make. `cut`: local nets cut out of scenarios;

mod cut;
mod shipped;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;
use dials_core::base::AgentId;
use dials_traffic::cut::forest::{Region, write_forest};
use dials_traffic::network::contents::Network;
use dials_traffic::network::files::NetworkFiles;
use dials_traffic::network::way_out::Role;
use dials_traffic::paper_grid::grid::{Grid, Node, lane};
use dials_traffic::paper_grid::make::{write_grid, write_local};
use dials_traffic::paper_grid::recognise::recognise_grid;
use dials_traffic::side::Side;
use quick_xml::events::Event;
use quick_xml::{Reader, XmlVersion};
use tempfile::TempDir;

use crate::free_car::FREE_CAR;
use crate::plain_sumo;

/// Inflow of the saved grids: the authors' setup.
const INFLOW: f64 = 0.1;

fn room() -> TempDir {
    tempfile::tempdir().expect("a temporary directory")
}

fn grid(rows: usize, cols: usize) -> Grid {
    Grid::new(rows, cols).expect("a grid of the test")
}

fn saved(name: &str) -> NetworkFiles {
    NetworkFiles::of(&Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").join(name))
}

/// Returns the networks of `sumo_nets/`: the paper's grids and the local net.
fn all_saved() -> Vec<(NetworkFiles, Grid)> {
    let grids = [2, 5, 7, 10].map(|size| (saved(&format!("grid_{size}x{size}")), grid(size, size)));
    grids.into_iter().chain([(saved("local"), Grid::SINGLE)]).collect()
}

fn all_files(network: &NetworkFiles) -> [&PathBuf; 4] {
    [&network.net, &network.routes, &network.actuated, &network.config]
}

fn make(shape: Grid, dir: &Path) -> NetworkFiles {
    write_grid(shape, INFLOW, dir).expect("netconvert is installed and the directory writable")
}

type Attributes = BTreeMap<String, String>;

/// Returns all elements of one kind in a file. It has its own reader, because the reader in the crate is under test
/// too.
fn elements(path: &Path, kind: &str) -> Vec<Attributes> {
    elements_of(&fs::read_to_string(path).expect("a file of the test"), kind)
}

fn elements_of(text: &str, kind: &str) -> Vec<Attributes> {
    let mut reader = Reader::from_str(text);
    let mut found = Vec::new();
    loop {
        match reader.read_event().expect("XML") {
            Event::Start(tag) | Event::Empty(tag) if tag.name().as_ref() == kind => {
                let attributes = tag.attributes().map(|attribute| {
                    let attribute = attribute.expect("an attribute");
                    let value = attribute.normalized_value(XmlVersion::Implicit1_0).expect("a value");
                    (attribute.key.as_ref().to_owned(), value.into_owned())
                });
                found.push(attributes.collect());
            }
            Event::Eof => return found,
            _ => {}
        }
    }
}

/// Runs `sumo` and returns its standard error. SUMO_HOME is removed, because not everyone has it.
fn sumo(arguments: &[&str]) -> String {
    let output = Command::new(plain_sumo())
        .args(arguments)
        .env_remove("SUMO_HOME")
        .output()
        .expect("Debian's package sumo is installed");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "sumo {arguments:?}: {}: {said}", output.status);
    said
}

fn text(path: &Path) -> &str {
    path.to_str().expect("the paths of the tests are UTF-8")
}

#[test]
fn remaking_the_saved_networks_gives_the_same_files_byte_for_byte() {
    if !crate::is_reference() {
        return eprintln!("not tested: the saved networks were made by netconvert 1.15, and others write other nets");
    }
    let room = room();
    for (saved, shape) in all_saved() {
        let remade = match shape {
            Grid::SINGLE => write_local(room.path()).expect("netconvert is installed"),
            shape => make(shape, room.path()),
        };
        for (old, new) in all_files(&saved).into_iter().zip(all_files(&remade)) {
            let same = fs::read(old).expect("a saved file") == fs::read(new).expect("a remade file");
            assert!(same, "{} differs from the remade one", old.display());
        }
    }
    assert_eq!(fs::read_dir(room.path()).expect("readable").count(), 5 * 4, "nothing else is left there");
}

#[test]
fn plain_sumo_plays_every_saved_network_and_has_nothing_to_say() {
    for (network, _) in all_saved() {
        assert_eq!(sumo(&["-c", text(&network.config), "--end", "200"]), "", "{}", network.config.display());
    }
}

#[test]
fn every_edge_is_100_m_and_every_lane_inside_an_intersection_18_8_m_in_length_and_in_shape() {
    for (network, shape) in all_saved() {
        let lanes = elements(&network.net, "lane");
        let (internal, outer): (Vec<_>, Vec<_>) = lanes.iter().partition(|lane| lane["id"].starts_with(':'));
        let agents = shape.agents().len();
        assert_eq!(internal.len(), 4 * agents);
        assert_eq!(outer.len(), 4 * agents + 2 * (shape.rows() + shape.cols()));
        for (lanes, length) in [(internal, 18.8), (outer, 100.0)] {
            for lane in lanes {
                assert_eq!(lane["length"].parse(), Ok(length), "{}", lane["id"]);
                assert!((shape_length(&lane["shape"]) - length).abs() < 1e-9, "{}", lane["id"]);
                assert_eq!(lane["speed"], "10.00");
            }
        }
    }
}

/// Returns the distance between the two ends of a straight lane.
fn shape_length(shape: &str) -> f64 {
    let numbers: Vec<f64> = shape.split([' ', ',']).map(|number| number.parse().expect("a coordinate")).collect();
    let [x0, y0, x1, y1] = numbers[..] else { panic!("{shape} is not straight") };
    (x1 - x0).hypot(y1 - y0)
}

#[test]
fn the_intersection_of_agent_0_lies_at_the_origin_in_the_south_west_corner() {
    let junctions = elements(&saved("grid_5x5").net, "junction");
    let place = |id: &str| {
        let junction = junctions.iter().find(|junction| junction["id"] == id).expect("a junction of the grid");
        (junction["x"].clone(), junction["y"].clone())
    };
    // Spacing 100 + 2 * 9.4 = 118.8 m.
    assert_eq!(place(&grid(5, 5).light(AgentId(0))), ("0.00".into(), "0.00".into()));
    assert_eq!(place(&grid(5, 5).light(AgentId(5))), ("0.00".into(), "118.80".into()));
    assert_eq!(place(&grid(5, 5).light(AgentId(4))), ("475.20".into(), "0.00".into()));
}

#[test]
fn only_intersections_have_lights() {
    for (network, shape) in all_saved() {
        let lights: BTreeSet<String> =
            elements(&network.net, "tlLogic").iter().map(|light| light["id"].clone()).collect();
        assert_eq!(lights, shape.agents().into_iter().map(|agent| shape.light(agent)).collect());
    }
}

#[test]
fn a_car_goes_straight_on_and_its_letter_of_the_light_is_north_east_south_west() {
    for (network, shape) in all_saved() {
        let connections = elements(&network.net, "connection");
        for agent in shape.agents() {
            let (from, to, inside) =
                (shape.incoming_edges(agent), shape.outgoing_edges(agent), shape.internal_lanes(agent));
            for (place, side) in Side::ALL.into_iter().enumerate() {
                let ways: Vec<_> = connections.iter().filter(|way| way["from"] == from[place]).collect();
                let [way] = ways[..] else { panic!("{}: {} ways on", from[place], ways.len()) };
                let opposite = (place + 2) % 4; // west <-> east, south <-> north
                assert_eq!(way["to"], to[opposite]);
                assert_eq!(way["dir"], "s");
                assert_eq!(way["tl"], shape.light(agent));
                assert_eq!(way["linkIndex"], ["3", "2", "1", "0"][place], "{side:?}");
                assert_eq!(way["via"], inside[place]);
            }
        }
    }
}

#[test]
fn a_grid_of_any_shape_can_be_made_played_and_recognised() {
    let room = room();
    for (rows, cols) in [(1, 1), (1, 3), (3, 2)] {
        let network = make(grid(rows, cols), room.path());
        network.check().expect("all files are there");
        assert_eq!(recognised(&network).expect("one of our grids"), grid(rows, cols));
        assert_eq!(sumo(&["-c", text(&network.config), "--end", "100"]), "");
    }
}

#[test]
fn the_saved_networks_are_recognised() {
    for (network, shape) in all_saved() {
        assert_eq!(recognised(&network).expect("one of our grids"), shape);
    }
}

#[test]
fn whatever_is_made_here_passes_with_any_inflow() {
    let room = room();
    for rows in 1..=10 {
        for cols in [1, 2, 3, 10] {
            let network = make(grid(rows, cols), room.path());
            assert_eq!(recognised(&network).expect("one of our grids"), grid(rows, cols));
        }
    }
    for inflow in [0.0, 1e-3, 0.25, 1.0] {
        let network = write_grid(grid(2, 3), inflow, room.path()).expect("netconvert is installed");
        assert_eq!(recognised(&network).expect("one of our grids"), grid(2, 3));
    }
    let local = write_local(room.path()).expect("netconvert is installed");
    write_forest(&local, 2, room.path()).expect("the local net");
}

/// A file of a network, what is replaced in it, and what the error says about it.
struct Damage {
    ending: &'static str,
    from: String,
    to: String,
    message: String,
}

fn damage(ending: &'static str, [from, to]: [&str; 2], message: &str) -> Damage {
    Damage { ending, from: from.to_owned(), to: to.to_owned(), message: message.to_owned() }
}

/// Another value of an attribute. `before`: what stands before the attribute in the file.
fn value(ending: &'static str, element: &str, before: &str, key: &str, [old, new]: [&str; 2]) -> Damage {
    let [from, to] = [old, new].map(|value| format!("{before}{key}=\"{value}\""));
    let message = format!("{element}: {key}=\"{new}\", and this program simulates {key}=\"{old}\"");
    Damage { ending, from, to, message }
}

/// An attribute that this program does not write. `before`: what it is put behind.
fn added(ending: &'static str, element: &str, before: &str, attribute: &str) -> Damage {
    let message = format!("{element}: {attribute}, and this program simulates none");
    damage(ending, [before, &format!("{before}{attribute} ")], &message)
}

/// Returns the grid that a network is made for.
fn recognised(network: &NetworkFiles) -> Result<Grid> {
    recognise_grid(network).map(|found| found.grid)
}

fn copied(network: &NetworkFiles, dir: &Path, name: &str) -> Result<NetworkFiles> {
    Network::read(network, Role::Global)?.copy_to(dir, name)
}

/// Makes a damaged copy of a saved network. Returns its files and the path of the damaged one.
fn damaged(name: &str, damage: &Damage, dir: &Path) -> (NetworkFiles, PathBuf) {
    let copy = copied(&saved(name), dir, name).expect("a saved network");
    let file = dir.join(format!("{name}{}", damage.ending));
    let before = fs::read_to_string(&file).expect("a copy");
    assert!(before.contains(&damage.from), "{} is not in {}", damage.from, file.display());
    fs::write(&file, before.replacen(&damage.from, &damage.to, 1)).expect("a writable directory");
    (copy, file)
}

const NET: &str = ".net.xml";
const ROUTES: &str = ".rou.xml";
const ACTUATED: &str = ".actuated.add.xml";

fn damages_of_the_net() -> Vec<Damage> {
    let [lane, edge] = [r#"lane "w0_r0c0_0""#, r#"edge "w0_r0c0""#];
    let connection = r#"connection from "e0_r0c1""#;
    let second_lane = r#"<lane id="w0_r0c0_1" index="1" speed="10.00" length="100.00""#;
    let straight_on = r#"<connection from="w0_r0c0" to="r0c0_r0c1" fromLane="0" toLane="0" via=":r0c0_3_0""#;
    let whole = format!(r#"{straight_on} tl="r0c0" linkIndex="3" dir="s" state="o"/>"#);
    let left = r#"<connection from="w0_r0c0" to="r0c0_r1c0" dir="l""#;
    let wide = ["-109.40,-1.60 -9.40,-1.60", "-109.40,-1.60 -50,7 -9.40,-1.60"];
    vec![
        value(
            NET,
            r#"lane "r0c0_r0c1_0""#,
            r#"id="r0c0_r0c1_0" index="0" speed="10.00" "#,
            "length",
            ["100.00", "60.00"],
        ),
        value(NET, r#"lane ":r0c0_0_0""#, r#"index="0" speed="10.00" "#, "length", ["18.80", "12.8"]),
        value(NET, lane, r#"id="w0_r0c0_0" index="0" "#, "speed", ["10.00", "13.89"]),
        damage(
            NET,
            [r#"<lane id="w0_r0c0_0""#, &format!(r#"{second_lane}/><lane id="w0_r0c0_0""#)],
            &format!("it has {second_lane}>, and this program simulates none"),
        ),
        damage(
            NET,
            [r#"<lane id="w0_r0c0_0""#, r#"<lane allow="bus" id="w0_r0c0_0""#],
            r#"lane "w0_r0c0_0": allow="bus", and this program simulates none"#,
        ),
        value(NET, lane, "", "shape", wide),
        value(NET, edge, r#"from="w0" "#, "to", ["r0c0", "r0c1"]),
        added(NET, edge, r#"<edge id="w0_r0c0" "#, r#"type="highway""#),
        added(NET, "net", "<net ", r#"lefthand="true""#),
        damage(NET, [&whole, ""], &format!("it lacks {straight_on}")),
        damage(
            NET,
            ["<connection ", &format!("{left}/><connection ")],
            r#"connection from "w0_r0c0": to="r0c0_r1c0", and this program simulates to="r0c0_r0c1""#,
        ),
        damage(
            NET,
            ["\n</net>", &format!("{left}/></net>")],
            &format!(r#"it has connection from "w0_r0c0" twice, the second time as {left}>"#),
        ),
        value(NET, connection, r#"tl="r0c1" linkIndex="1" "#, "dir", ["s", "t"]),
        value(NET, connection, r#"tl="r0c1" "#, "linkIndex", ["1", "2"]),
        value(NET, connection, "", "via", [":r0c1_1_0", ":r0c1_2_0"]),
        value(NET, r#"junction "r0c0""#, r#"id="r0c0" "#, "type", ["traffic_light", "priority"]),
        damage(
            NET,
            [r#"x="118.80" y="0.00""#, r#"x="218.80" y="0.00""#],
            r#"junction "r0c1": x="218.80", and this program simulates x="118.80""#,
        ),
        value(NET, r#"request 2 of junction "r0c0""#, "", "response", ["0101", "0000"]),
        damage(
            NET,
            [r#"duration="3"  state="yryr""#, r#"duration="4" state="yryr""#],
            r#"phase 2 of tlLogic "r0c0": duration="4", and this program simulates duration="3""#,
        ),
        value(NET, r#"phase 3 of tlLogic "r0c0""#, "", "state", ["rGrG", "GrGr"]),
    ]
}

fn damages_of_lights_and_cars() -> Vec<Damage> {
    let (car, flow) = (r#"vType "car""#, r#"flow "w0""#);
    vec![
        value(ACTUATED, r#"phase 1 of tlLogic "r0c0""#, "", "maxDur", ["45", "60"]),
        value(ACTUATED, r#"param 1 of tlLogic "r0c0""#, r#"key="max-gap" "#, "value", ["3.0", "2"]),
        damage(
            ACTUATED,
            [r#"<tlLogic id="r0c1""#, r#"<tlLogic id="r9c9""#],
            r#"it has <tlLogic id="r9c9" type="actuated" programID="actuated" offset="0">, and this program simulates"#,
        ),
        value(ROUTES, car, "", "accel", ["2.6", "1.5"]),
        value(ROUTES, car, "", "decel", ["7.5", "4.5"]),
        value(ROUTES, car, r#"minGap="2.5" "#, "length", ["5", "12"]),
        damage(ROUTES, [r#" tau="1.0""#, ""], r#"vType "car": has no tau, and this program simulates tau="1.0""#),
        value(ROUTES, car, "", "speedDev", ["0", "0.1"]),
        value(ROUTES, car, "", "carFollowModel", ["IDM", "Krauss"]),
        added(ROUTES, car, r#"speedFactor="1" "#, r#"sigma="0.5""#),
        value(ROUTES, r#"route "w0_to_e0""#, "", "edges", ["w0_r0c0 r0c0_r0c1 r0c1_e0", "w0_r0c0 r0c0_r1c0 r1c0_n0"]),
        value(ROUTES, flow, "", "route", ["w0_to_e0", "w1_to_e1"]),
        value(ROUTES, flow, "", "departSpeed", ["10", "max"]),
        damage(
            ROUTES,
            [r#"probability="0.1""#, r#"probability="nan""#],
            r#"flow "w0": probability="nan", and this program simulates probabilities above 0 and up to 1"#,
        ),
        damage(
            ROUTES,
            [r#"<flow id="w0""#, r#"<flow id="bus""#],
            r#"it has <flow id="bus" type="car" route="w0_to_e0" begin="0""#,
        ),
    ]
}

#[test]
fn a_grid_with_our_names_and_other_content_is_refused_with_the_file_the_element_and_both_values() {
    let room = room();
    for damage in damages_of_the_net().into_iter().chain(damages_of_lights_and_cars()) {
        let (network, file) = damaged("grid_2x2", &damage, room.path());
        let message = format!("{:#}", recognised(&network).expect_err(&damage.message));
        let expected = format!("{}: {}", file.display(), damage.message);
        assert!(message.starts_with(&expected), "{message}\nis not\n{expected}");
        let way_out = format!(
            "remake it with: dials-traffic nets grid --rows 2 --cols 2 --out {} --force",
            room.path().display()
        );
        assert!(message.ends_with(&way_out), "{message}");
    }
}

#[test]
fn a_local_net_with_our_names_and_other_content_is_refused_likewise() {
    let room = room();
    let damages = [
        value(NET, r#"lane "e0_r0c0_0""#, r#"speed="10.00" "#, "length", ["100.00", "60.00"]),
        value(ROUTES, r#"vType "car""#, "", "minGap", ["2.5", "2"]),
        damage(
            ROUTES,
            ["</routes>", r#"<flow id="w0" route="w0_to_e0"/></routes>"#],
            r#"it has <flow id="w0" route="w0_to_e0">, and this program simulates none"#,
        ),
    ];
    for damage in &damages {
        let (network, file) = damaged("local", damage, room.path());
        let message = format!("{:#}", write_forest(&network, 2, room.path()).expect_err(&damage.message));
        let way_out = "make one with: dials-traffic nets local --out DIR";
        assert_eq!(message, format!("{}: {}; {way_out}", file.display(), damage.message));
    }
}

#[test]
fn cars_may_come_more_often_from_one_side_or_not_at_all() {
    let room = room();
    let flow = r#"<flow id="w0" type="car" route="w0_to_e0" begin="0" end="86400" probability="0.1" departLane="free" departSpeed="10"/>"#;
    for to in [&*flow.replace("0.1", "0.35"), ""] {
        let (network, _) = damaged("grid_2x2", &damage(ROUTES, [flow, to], ""), room.path());
        assert_eq!(recognised(&network).expect("one of our grids"), grid(2, 2));
    }
}

#[test]
fn a_network_that_is_called_otherwise_is_remade_elsewhere() {
    let room = room();
    let copy = copied(&saved("grid_2x2"), room.path(), "global").expect("a saved network");
    let net = fs::read_to_string(&copy.net).expect("a copy");
    fs::write(&copy.net, net.replace("10.00", "15.00")).expect("a writable directory");
    let message = recognised(&copy).expect_err("another limit").to_string();
    assert!(message.ends_with("make one with: dials-traffic nets grid --rows 2 --cols 2 --out DIR"), "{message}");
}

#[test]
fn routes_cross_the_whole_grid_and_each_has_a_flow_of_the_given_probability() {
    let room = room();
    let network = write_grid(grid(3, 2), 0.25, room.path()).expect("netconvert is installed");
    let routes = elements(&network.routes, "route");
    // From west and east: 3 routes over 2 intersections = 3 edges. From south and north: 2 over 3 = 4 edges.
    let lengths: Vec<usize> = routes.iter().map(|route| route["edges"].split(' ').count()).collect();
    assert_eq!(lengths, [3, 3, 3, 4, 4, 3, 3, 3, 4, 4]);
    let flows = elements(&network.routes, "flow");
    let flown: Vec<&String> = flows.iter().map(|flow| &flow["route"]).collect();
    assert_eq!(flown, routes.iter().map(|route| &route["id"]).collect::<Vec<_>>());
    assert!(flows.iter().all(|flow| flow["probability"] == "0.25"));
    for boundary in grid(3, 2).nodes().into_iter().filter(|node| matches!(node, Node::Boundary { .. })) {
        assert!(flows.iter().any(|flow| flow["id"] == boundary.to_string()));
    }
}

#[test]
fn the_local_net_is_a_grid_of_one_without_flows() {
    let room = room();
    let (local, single) = (write_local(room.path()).expect("netconvert is installed"), make(Grid::SINGLE, room.path()));
    assert_eq!(fs::read(&local.net).expect("a net"), fs::read(&single.net).expect("a net"));
    assert_eq!(elements(&local.routes, "vType"), elements(&single.routes, "vType"));
    assert_eq!(elements(&local.routes, "route"), elements(&single.routes, "route"));
    assert_eq!((elements(&local.routes, "flow").len(), elements(&single.routes, "flow").len()), (0, 4));
}

#[test]
fn without_inflow_a_grid_is_empty_and_can_be_played() {
    let room = room();
    let network = write_grid(grid(1, 2), 0.0, room.path()).expect("netconvert is installed");
    assert_eq!(sumo(&["-c", text(&network.config), "--end", "10"]), "");
}

#[test]
fn the_actuated_lights_take_over_when_their_file_is_loaded() {
    let room = room();
    let (recorder, record) = (room.path().join("recorder.add.xml"), room.path().join("lights.xml"));
    let event = format!(r#"<timedEvent type="SaveTLSStates" source="r0c1" dest="{}"/>"#, record.display());
    fs::write(&recorder, format!("<additional>{event}</additional>")).expect("a writable directory");
    let network = saved("grid_2x2");
    let additional = format!("{},{}", network.actuated.display(), recorder.display());
    let said = sumo(&["-c", text(&network.config), "--end", "200", "-a", &additional]);
    // SUMO 1.15 warns that yellow ends by the clock alone, as in the authors' baseline.
    assert!(said.lines().all(|line| line.ends_with("has no controlling detector.")), "{said}");

    let states = elements(&record, "tlsState");
    assert!(states.len() >= 200 && states.iter().all(|state| state["programID"] == "actuated"));
    let mut phases: Vec<(&str, u32)> = Vec::new();
    for state in &states {
        match phases.last_mut() {
            Some((last, seconds)) if *last == state["state"] => *seconds += 1,
            _ => phases.push((&state["state"], 1)),
        }
    }
    phases.pop(); // Cut off by the end of the run.
    let cycle = ["GrGr", "yryr", "rGrG", "ryry"].into_iter().cycle();
    for ((state, seconds), expected) in phases.into_iter().zip(cycle) {
        assert_eq!(state, expected);
        let limits = if state.contains('y') { 3..=6 } else { 8..=45 };
        assert!(limits.contains(&seconds), "{state} for {seconds} s");
    }
}

#[test]
fn making_a_network_replaces_its_own_files_and_no_others() {
    let room = room();
    let ours = room.path().join("grid_1x1.net.xml");
    let foreign = room.path().join("grid_1x2.net.xml");
    for path in [&ours, &foreign] {
        fs::write(path, "old").expect("a writable directory");
    }
    make(Grid::SINGLE, room.path());
    assert_ne!(fs::read_to_string(&ours).expect("a net"), "old");
    assert_eq!(fs::read_to_string(&foreign).expect("unchanged"), "old");
    // The files are as readable for others as any other written file.
    let mode = |path: &Path| fs::metadata(path).expect("a file").permissions().mode();
    assert_eq!(mode(&ours), mode(&foreign));
}

#[test]
fn a_directory_that_cannot_be_written_to_is_named_in_the_error() {
    let room = room();
    let file = room.path().join("file");
    fs::write(&file, "").expect("a writable directory");
    // A file in the place of the directory, and a directory that takes no files, not even from root.
    for dir in [file.join("nets"), PathBuf::from("/proc/self")] {
        let error = write_local(&dir).expect_err("not writable").to_string();
        let expected = "could not be written to; make it writable or choose another directory";
        assert_eq!(error, format!("{}: {expected}", dir.display()));
    }
    assert_eq!(fs::read_dir(room.path()).expect("readable").count(), 1);
}

#[test]
fn a_copied_network_plays_in_its_new_directory() {
    let room = room();
    let dir = room.path().join("run/networks");
    let copy = copied(&saved("grid_2x2"), &dir, "global").expect("a saved network");
    assert_eq!(copy, NetworkFiles::of(&dir.join("global")));
    assert_eq!(sumo(&["-c", text(&copy.config), "--end", "50"]), "");

    let before = fs::read(&copy.net).expect("a net");
    copied(&copy, &dir, "global").expect("a network may be copied onto itself");
    assert_eq!(fs::read(&copy.net).expect("a net"), before);

    let missing = copied(&NetworkFiles::of(&dir.join("grid_4x4")), room.path(), "global").unwrap_err().to_string();
    assert!(missing.contains("grid_4x4.net.xml: no such network; make it with: "), "{missing}");
}

#[test]
fn a_net_that_is_not_one_of_our_grids_is_told_apart() {
    let room = room();
    let dir = room.path();
    let network = make(grid(1, 2), dir);
    let net = fs::read_to_string(&network.net).expect("a net");
    let copy = copied(&network, dir, "grid_9x9").expect("a network");
    let error_of = |text: &str| {
        fs::write(&copy.net, text).expect("a writable directory");
        format!("{:#}", recognised(&copy).unwrap_err()).replace(&format!("{}/", dir.display()), "")
    };
    // The cut leaves 100 bytes: two lines of declaration, then a tag that does not end.
    assert!(error_of(&net[..100]).starts_with("grid_9x9.net.xml: is not XML: "));
    assert!(error_of("<routes/>").ends_with("is not a SUMO network: its root is <routes>, not <net>"));
    let foreign = error_of("<net><edge id=\"gneE0\"/><junction id=\"gneJ1\"/></net>");
    let way_out = "make one with: dials-traffic nets grid --rows R --cols C --out DIR";
    assert_eq!(foreign, format!("grid_9x9.net.xml: is not one of our grids: it has the junction 'gneJ1'; {way_out}"));
    assert!(error_of("<net/>").contains("it lacks the junction 'e0'"));
    assert!(error_of(&net.replace("r0c1_r0c0\"", "other\"")).contains("it has the edge 'other'"));
    // A huge number in a name is not one of our names, and must not make the code count up to it.
    assert!(error_of(&net.replace("id=\"r0c1\"", "id=\"r0c99999999999\"")).contains("it has the junction "));

    let missing = recognised(&NetworkFiles::of(&dir.join("grid_3x3"))).unwrap_err().to_string();
    let command = format!("dials-traffic nets grid --rows 3 --cols 3 --out {}", dir.display());
    assert!(missing.ends_with(&format!("grid_3x3.net.xml: no such network; make it with: {command}")), "{missing}");
}

#[test]
fn the_lanes_of_a_forest_have_the_lengths_and_the_shapes_of_the_local_net() {
    let room = room();
    let forest = write_forest(&saved("local"), 3, room.path()).expect("the local net is saved");
    let lanes = |path: &Path| -> BTreeMap<String, Attributes> {
        let all = elements(path, "lane").into_iter();
        all.map(|mut lane| (lane.remove("id").expect("lanes have ids"), lane)).collect()
    };
    let (local, all) = (lanes(&saved("local").net), lanes(&forest.net));
    assert_eq!(all.len(), 3 * local.len());
    let only = AgentId(0);
    for region in [0, 1, 2].map(Region) {
        let here = [region.incoming_lanes(), region.internal_lanes(), region.outgoing_lanes()].concat();
        let alone = [
            Grid::SINGLE.incoming_edges(only).map(|edge| lane(&edge)),
            Grid::SINGLE.internal_lanes(only),
            Grid::SINGLE.outgoing_edges(only).map(|edge| lane(&edge)),
        ];
        for (id, id_alone) in here.iter().zip(alone.concat()) {
            assert_eq!(all[id], local[&id_alone], "{id}");
        }
    }
}

#[test]
fn every_region_of_a_forest_has_its_own_light_and_its_own_routes() {
    let room = room();
    let forest = write_forest(&saved("local"), 3, room.path()).expect("the local net is saved");
    let ids = |path, kind| elements(path, kind).iter().map(|element| element["id"].clone()).collect::<Vec<_>>();
    assert_eq!(ids(&forest.net, "tlLogic"), ["f0.r0c0", "f1.r0c0", "f2.r0c0"]);
    assert_eq!(ids(&forest.routes, "vType"), ["car"]);
    assert_eq!(ids(&forest.routes, "route"), [0, 1, 2].map(|region| Region(region).routes()).concat());
    for (number, route) in elements(&forest.routes, "route").iter().enumerate() {
        let (region, side) = (Region(number / 4), number % 4);
        let lanes = [&region.incoming_lanes()[side], &region.outgoing_lanes()[(side + 2) % 4]];
        let through: Vec<String> = route["edges"].split(' ').map(lane).collect();
        assert_eq!(through.iter().collect::<Vec<_>>(), lanes);
    }
    for connection in elements(&forest.net, "connection") {
        let region = |id: &str| id.trim_start_matches(':').split('.').next().map(str::to_owned);
        let names = ["from", "to", "via", "tl"].into_iter().filter_map(|key| connection.get(key));
        assert_eq!(names.map(|name| region(name)).collect::<BTreeSet<_>>().len(), 1, "{connection:?}");
    }
}

/// Returns cars for one region: one from each side every few seconds, so that some queue at the red light.
fn cars(prefix: &str) -> Vec<(u32, String)> {
    let mut cars = Vec::new();
    for (side, route) in Grid::SINGLE.boundary_routes().iter().enumerate() {
        for number in 0..12 {
            let depart = number * [5, 7, 11, 13][side];
            let how = r#"type="car" departPos="5" departSpeed="max""#;
            let id = format!("{prefix}{}.{number}", route.from);
            cars.push((
                depart,
                format!(r#"<vehicle id="{id}" route="{prefix}{}" depart="{depart}" {how}/>"#, route.id),
            ));
        }
    }
    cars
}

/// Returns what `sumo` writes of every car in every second, to 15 digits.
fn trajectories(net: &Path, routes: &Path, mut cars: Vec<(u32, String)>, dir: &Path) -> Vec<Attributes> {
    let (vehicles, fcd) = (dir.join("cars.rou.xml"), dir.join("fcd.xml"));
    cars.sort();
    let lines: Vec<String> = cars.into_iter().map(|(_, line)| line).collect();
    fs::write(&vehicles, format!("<routes>{}</routes>", lines.join("\n"))).expect("a writable directory");
    let routes = format!("{},{}", text(routes), text(&vehicles));
    let inputs = ["-n", text(net), "-r", &routes, "--end", "200", "--xml-validation", "never"];
    let outputs = ["--fcd-output", text(&fcd), "--precision", "15", "--fcd-output.acceleration"];
    assert_eq!(sumo(&[&inputs[..], &outputs[..], &["--time-to-teleport", "-1"]].concat()), "");
    elements(&fcd, "vehicle")
}

#[test]
fn every_region_of_a_forest_moves_bit_for_bit_like_the_local_net_alone() {
    let room = room();
    let local = saved("local");
    let forest = write_forest(&local, 3, room.path()).expect("the local net is saved");
    let alone = trajectories(&local.net, &local.routes, cars(""), room.path());
    assert!(alone.iter().any(|car| car["speed"].parse() == Ok(0.0)), "some car stands at a red light");

    let prefixes = ["f0.", "f1.", "f2."];
    let all_cars = prefixes.iter().flat_map(|prefix| cars(prefix)).collect();
    let together = trajectories(&forest.net, &forest.routes, all_cars, room.path());
    assert_eq!(together.len(), 3 * alone.len());
    for prefix in prefixes {
        let strip = |car: &Attributes| -> Attributes {
            car.iter().map(|(key, value)| (key.clone(), value.replacen(prefix, "", 1))).collect()
        };
        let here: Vec<Attributes> = together.iter().filter(|car| car["id"].starts_with(prefix)).map(strip).collect();
        assert!(here == alone, "{prefix} moves differently");
    }
}

#[test]
fn a_free_car_drives_through_the_local_net_as_the_authors_do() {
    let room = room();
    let (car, green, fcd) =
        (room.path().join("car.rou.xml"), room.path().join("green.add.xml"), room.path().join("fcd"));
    let vehicle = r#"<vehicle id="a" type="car" route="w0_to_e0" depart="0" departPos="6" departSpeed="9.5"/>"#;
    fs::write(&car, format!("<routes>{vehicle}</routes>")).expect("a writable directory");
    let phase = r#"<phase duration="100" state="rGrG"/>"#;
    let light = format!(r#"<tlLogic id="r0c0" type="static" programID="green">{phase}</tlLogic>"#);
    fs::write(&green, format!("<additional>{light}</additional>")).expect("a writable directory");
    let local = saved("local");
    let routes = format!("{},{}", text(&local.routes), text(&car));
    let inputs = ["-c", text(&local.config), "-r", &routes, "-a", text(&green), "--end", "40"];
    assert_eq!(sumo(&[&inputs[..], &["--fcd-output", text(&fcd), "--precision", "3"]].concat()), "");

    let seen = elements(&fcd, "vehicle");
    let positions: Vec<f64> = seen.iter().map(|car| car["pos"].parse().expect("a position")).collect();
    let reference: Vec<f64> = FREE_CAR.iter().map(|(_, position_m, _)| *position_m).collect();
    assert_eq!(positions, reference);
    let lanes = [0, 10, 12].map(|second| seen[second]["lane"].as_str());
    assert_eq!(lanes, ["w0_r0c0_0", ":r0c0_3_0", "r0c0_e0_0"]);
}

#[test]
fn a_forest_is_made_of_the_local_net_only() {
    let room = room();
    let refusal =
        |files: &NetworkFiles, regions| format!("{:#}", write_forest(files, regions, room.path()).unwrap_err());
    let grid = refusal(&saved("grid_2x2"), 3);
    assert!(grid.contains("grid_2x2.net.xml: is a grid of 2x2, and a forest is made of the local net"), "{grid}");
    assert!(refusal(&saved("local"), 0).ends_with("a forest of 0 regions: needs at least one"));
    assert!(refusal(&NetworkFiles::of(&room.path().join("local")), 3).contains("dials-traffic nets local --out "));
    // A 1x1 grid is the local net plus flows, and the cars of flows would not be arrivals.
    let flows = refusal(&make(Grid::SINGLE, &room.path().join("nets")), 3);
    assert!(flows.contains("grid_1x1.rou.xml: it has <flow id=\"w0\" type=\"car\""), "{flows}");
    assert!(flows.ends_with("make one with: dials-traffic nets local --out DIR"), "{flows}");
    assert!(!room.path().join("forest_3.net.xml").exists());
}
