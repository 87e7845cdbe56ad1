//! Local nets cut out of scenarios: SUMO loads them in silence, and they hold what the whole net holds. All of it is
//! read here again, by other code than the program's.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{Write, stderr};
use std::path::{Path, PathBuf};

use dials_traffic::config::ScenarioConfig;
use dials_traffic::cut::beyond::Reach;
use dials_traffic::cut::mixed::{MixedForest, prefix};
use dials_traffic::cut::of_scenario::{cut_light, write};
use dials_traffic::scenario::SumoScenario;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::shipped::{SCENARIOS, file};
use super::{Attributes, room, sumo, text};

/// How far an agent sees, in metres.
const APPROACH_M: f64 = 150.0;

#[derive(Clone, Debug, PartialEq)]
struct Node {
    name: String,
    attributes: Attributes,
    children: Vec<Node>,
}

impl Node {
    fn of(tag: &BytesStart) -> Node {
        let attributes = tag.attributes().map(|attribute| {
            let attribute = attribute.unwrap();
            let value = attribute.normalized_value(XmlVersion::Implicit1_0).unwrap();
            (attribute.key.as_ref().to_owned(), value.into_owned())
        });
        Node { name: tag.name().as_ref().to_owned(), attributes: attributes.collect(), children: Vec::new() }
    }

    fn read(path: &Path) -> Node {
        let text = fs::read_to_string(path).unwrap();
        let mut reader = Reader::from_str(&text);
        let mut open = vec![Node { name: String::new(), attributes: Attributes::new(), children: Vec::new() }];
        loop {
            match reader.read_event().unwrap() {
                Event::Start(tag) => open.push(Node::of(&tag)),
                Event::Empty(tag) => open.last_mut().unwrap().children.push(Node::of(&tag)),
                Event::End(_) => {
                    let done = open.pop().unwrap();
                    open.last_mut().unwrap().children.push(done);
                }
                Event::Eof => return open.remove(0).children.remove(0),
                _ => {}
            }
        }
    }

    fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Node> {
        self.children.iter().filter(move |child| child.name == name)
    }

    fn is(&self, key: &str, value: &str) -> bool {
        self.attributes.get(key).is_some_and(|known| known == value)
    }

    fn by_id<'a>(&'a self, name: &'a str) -> BTreeMap<&'a str, &'a Node> {
        self.all(name).map(|node| (&*node.attributes["id"], node)).collect()
    }
}

impl std::ops::Index<&str> for Node {
    type Output = str;

    fn index(&self, key: &str) -> &str {
        &self.attributes[key]
    }
}

/// Whether this is one of the program's own additions: copies of edges, their dead ends and the gate.
fn is_new(id: &str) -> bool {
    id.contains('+')
}

/// Returns an edge of a copy's name and the edge that it copies.
fn copied(id: &str) -> &str {
    id.rsplit_once('+').unwrap().1
}

/// Holds a cut against the whole net. `hops`: largest number of copies one behind the other.
fn compare(whole: &Node, cut: &Node, light: &str, hops: usize) {
    // Attributes of another namespace name the place of a schema.
    let plain = |net: &Node| net.attributes.clone().into_iter().filter(|(key, _)| !key.contains(':'));
    assert!(plain(whole).eq(plain(cut)), "{light}: {:?}", cut.attributes);
    let [edges, cut_edges] = [whole, cut].map(|net| net.by_id("edge"));
    let [junctions, cut_junctions] = [whole, cut].map(|net| net.by_id("junction"));
    let is_within = |junction: &str| cut_junctions.get(junction).is_some_and(|found| !found.is("type", "dead_end"));
    for (id, edge) in cut_edges.iter().filter(|(id, _)| !is_new(id)) {
        assert_eq!(edges[id], *edge, "{light}: edge, lanes, lengths, shapes, speeds and permissions");
    }
    for (id, edge) in &edges {
        let around = id.strip_prefix(':').map(|name| name.rsplit_once('_').unwrap().0);
        let belongs = around.map_or_else(|| ["from", "to"].iter().any(|end| is_within(&edge[end])), is_within);
        assert_eq!(belongs, cut_edges.contains_key(id), "{light}: edge {id}");
    }
    let lanes: BTreeSet<&str> = cut_edges.values().flat_map(|edge| edge.all("lane")).map(|lane| &lane["id"]).collect();
    for (id, junction) in cut_junctions.iter().filter(|(id, _)| !is_new(id)) {
        if !junction.is("type", "dead_end") {
            assert_eq!(junctions[id], *junction, "{light}: junction and right of way");
            continue;
        }
        let left: Vec<&str> = junctions[id]["incLanes"].split(' ').filter(|lane| lanes.contains(lane)).collect();
        assert_eq!((left.join(" "), ""), (junction["incLanes"].to_owned(), &junction["intLanes"]), "{light}: {id}");
        assert_eq!([&junction["x"], &junction["y"]], [&junctions[id]["x"], &junctions[id]["y"]], "{light}: {id}");
    }
    compare_connections(whole, cut, light, is_within);
    compare_copies(whole, cut, light, hops, is_within);
    let programs = |net: &Node| net.all("tlLogic").filter(|node| node.is("id", light)).cloned().collect::<Vec<_>>();
    assert_eq!(programs(whole), programs(cut), "{light}");
    let own = format!("{light}+exits");
    assert!(cut.all("tlLogic").all(|node| node.is("id", light) || node.is("id", &own)), "{light}");
}

fn compare_connections(whole: &Node, cut: &Node, light: &str, is_within: impl Fn(&str) -> bool) {
    let [edges, cut_edges] = [whole, cut].map(|net| net.by_id("edge"));
    let is_old = |node: &&Node| !is_new(&node["to"]);
    let kept = |node: &&Node| match edges[&node["from"]].attributes.get("to") {
        Some(end) => is_within(end),
        None => cut_edges.contains_key(&node["from"]),
    };
    let of_whole: Vec<&Node> = whole.all("connection").filter(kept).collect();
    let of_cut: Vec<&Node> = cut.all("connection").filter(is_old).collect();
    assert_eq!(of_whole, of_cut, "{light}: connections, with vias and link indices");
    let links = |net: &Node| net.all("connection").filter(|node| node.is("tl", light)).count();
    assert!(links(cut) > 0 && links(whole) == links(cut), "{light}: every letter has its links");
}

/// Holds that behind an exit there are the same ways as in the whole net.
fn compare_copies(whole: &Node, cut: &Node, light: &str, hops: usize, is_within: impl Fn(&str) -> bool) {
    let [edges, cut_edges] = [whole, cut].map(|net| net.by_id("edge"));
    type Link = (String, String, String, String);
    let link = |node: &Node, to: &str| -> Link {
        (node["from"].to_owned(), node["fromLane"].to_owned(), to.to_owned(), node["toLane"].to_owned())
    };
    let exits: BTreeSet<&str> = cut_edges
        .iter()
        .filter(|(id, edge)| edge.attributes.get("to").is_some_and(|end| !is_new(id) && !is_within(end)))
        .map(|(id, _)| *id)
        .collect();
    let is_road = |edge: &str| !edges[edge].attributes.contains_key("function");
    let behind = whole.all("connection").filter(|node| exits.contains(&node["from"]) && is_road(&node["to"]));
    let behind: BTreeSet<Link> = behind.filter(|_| hops > 0).map(|node| link(node, &node["to"])).collect();
    let copies = cut.all("connection").filter(|node| is_new(&node["to"]) && !is_new(&node["from"]));
    let copies: BTreeSet<Link> = copies.map(|node| link(node, copied(&node["to"]))).collect();
    assert_eq!(behind, copies, "{light}: what is behind the exits");
    let without_id = |edge: &Node| -> Vec<Attributes> {
        let mut lanes: Vec<Attributes> = edge.all("lane").map(|lane| lane.attributes.clone()).collect();
        lanes.iter_mut().for_each(|lane| drop(lane.remove("id")));
        lanes
    };
    for (id, copy) in cut_edges.iter().filter(|(id, _)| is_new(id)) {
        assert_eq!(without_id(copy), without_id(edges[copied(id)]), "{light}: {id}");
    }
}

/// Cuts out every light of a scenario, plays each cut and compares it.
///
/// Returns the number of lights, and how often a car braked hard: some lights lead cars into that, on the whole net, too.
fn check(scenario: &Path, reach: Reach) -> (usize, usize) {
    let scenario = SumoScenario::read(&ScenarioConfig::of_file(scenario).unwrap()).unwrap();
    let whole = Node::read(scenario.net_path());
    let lights: BTreeSet<&str> = whole.all("tlLogic").map(|light| &light["id"]).collect();
    let mut brakings = 0;
    for light in &lights {
        let room = room();
        let net = cut_light(&scenario, light, APPROACH_M, reach).unwrap();
        let files = write(&net, &scenario, room.path()).unwrap();
        let counts = room.path().join("counts.xml");
        let outputs = ["--no-step-log", "--end", "300", "--statistic-output", text(&counts)];
        let said = sumo(&[&["-c", text(&files.config)][..], &outputs].concat());
        let (hard, other): (Vec<&str>, Vec<&str>) =
            said.lines().partition(|line| line.contains("performs emergency braking"));
        assert_eq!(other, [""; 0], "{}, light {light}: SUMO has nothing to say", scenario.path().display());
        brakings += hard.len();
        let played = Node::read(&counts);
        let arrived = |key: &str| played.all("vehicles").next().unwrap()[key].parse::<u32>().unwrap();
        assert!(arrived("inserted") > arrived("running"), "{light}: cars go through the region");
        compare(&whole, &Node::read(&files.net), light, reach.hops);
    }
    (lights.len(), brakings)
}

#[test]
fn every_light_of_the_shipped_scenarios_can_be_cut_out_as_it_is() {
    let cut = SCENARIOS.map(|name| check(&file(name, "sumocfg"), Reach::default()));
    assert_eq!(cut, [(16, 0), (20, 0), (6, 0)]);
}

#[test]
fn plain_sumo_has_nothing_to_say_of_a_forest_and_numbers_its_lanes_as_the_program_does() {
    let nets = SCENARIOS.map(|name| {
        let scenario = SumoScenario::read(&ScenarioConfig::of_file(&file(name, "sumocfg")).unwrap()).unwrap();
        let light = Node::read(scenario.net_path()).all("tlLogic").next().unwrap()["id"].to_owned();
        cut_light(&scenario, &light, APPROACH_M, Reach::default()).unwrap()
    });
    // Different nets, and one of them twice.
    let rows = [&nets[0], &nets[1], &nets[2], &nets[1]];
    let forest = MixedForest::of(&rows);
    let room = room();
    let net = room.path().join("forest.net.xml");
    fs::write(&net, &forest.net).unwrap();
    let quiet = ["-n", text(&net), "--end", "10", "--no-step-log", "--xml-validation", "never"];
    let generators = forest.option();
    assert_eq!(sumo(&[&quiet[..], &generators.each_ref().map(String::as_str)].concat()), "");
    // SUMO numbers lanes in the order of the file, and all those of a row stand together.
    let whole = Node::read(&net);
    let lanes: Vec<&str> = whole.all("edge").flat_map(|edge| edge.all("lane").map(|lane| &lane["id"])).collect();
    for (row, net) in rows.iter().enumerate() {
        let [first, end] = [row, row + 1].map(|row| forest.first_lane[row] as usize);
        assert_eq!(end - first, net.lanes().count());
        assert!(
            lanes[first..end].iter().all(|lane| lane.trim_start_matches(':').starts_with(&prefix(row))),
            "row {row}"
        );
    }
    assert_eq!(lanes[lanes.len() - 1], "apart_0");
}

#[test]
fn copies_behind_the_exits_reach_as_far_as_asked() {
    let arterial = file("arterial", "sumocfg");
    assert_eq!(check(&arterial, Reach { hops: 0, metres: 150.0 }), (6, 0));
    let scenario = SumoScenario::read(&ScenarioConfig::of_file(&arterial).unwrap()).unwrap();
    let light = Node::read(scenario.net_path()).all("tlLogic").next().unwrap()["id"].to_owned();
    let hops = |hops, metres| {
        let net = cut_light(&scenario, &light, APPROACH_M, Reach { hops, metres }).unwrap();
        net.exits.iter().flat_map(|exit| &exit.ways).map(|way| way.copies.len()).max()
    };
    assert_eq!([hops(0, 150.0), hops(1, 150.0), hops(3, 0.1), hops(3, 1e6)], [0, 1, 1, 3].map(Some));
}

#[test]
fn a_red_gate_holds_all_cars_back() {
    let scenario = SumoScenario::read(&ScenarioConfig::of_file(&file("grid_4x4_turns", "sumocfg")).unwrap()).unwrap();
    let room = room();
    // Behind every exit of this light there is another light.
    let net = cut_light(&scenario, "x1y1", APPROACH_M, Reach::default()).unwrap();
    let files = write(&net, &scenario, room.path()).unwrap();
    let gate = net.gate.unwrap();
    let exits: Vec<&String> = net.exits.iter().flat_map(|exit| &exit.lanes).collect();
    assert_eq!(gate.lanes.iter().collect::<Vec<_>>(), exits);
    let counts = room.path().join("counts.xml");
    let arrived = || {
        let outputs = ["--no-step-log", "--end", "300", "--statistic-output", text(&counts)];
        assert_eq!(sumo(&[&["-c", text(&files.config)][..], &outputs].concat()), "");
        let counts = Node::read(&counts);
        let vehicles = counts.all("vehicles").next().unwrap();
        let [inserted, running] = ["inserted", "running"].map(|key| vehicles[key].parse::<u32>().unwrap());
        assert!(inserted > 50, "{inserted}");
        inserted - running
    };
    assert!(arrived() > 50);
    let state = |letter: &str| format!("state=\"{}\"", letter.repeat(gate.lanes.len()));
    let green = fs::read_to_string(&files.net).unwrap();
    let (before, of_gate) = green.split_once(&format!("<tlLogic id=\"{}\"", gate.light)).unwrap();
    let red = of_gate.replacen(&state("G"), &state("r"), 1);
    fs::write(&files.net, format!("{before}<tlLogic id=\"{}\"{red}", gate.light)).unwrap();
    assert_eq!(arrived(), 0);
}

#[test]
fn nets_cut_writes_over_its_own_files_only_and_an_unknown_light_is_told() {
    let room = room();
    let arterial = file("arterial", "sumocfg");
    let out = room.path().join("cut");
    let cut = |light: &str, more: &[&str]| {
        let args = ["nets", "cut", text(&arterial), "--light", light, "--out", text(&out)];
        assert_cmd::cargo::cargo_bin_cmd!("dials-traffic").args(args).args(more).assert()
    };
    let told = String::from_utf8(cut("A1", &[]).code(2).get_output().stderr.clone()).unwrap();
    let list = format!("list all with: dials-traffic nets inspect {}", arterial.display());
    assert!(
        told.contains(&format!("arterial.net.xml: has no light `A1` (did you mean `a1` or `a2` or `a3`?); {list}")),
        "{told}"
    );
    assert!(!out.exists());
    cut("a1", &["--hops", "6"]).code(2);
    fs::create_dir(&out).unwrap();
    fs::write(out.join("mine.txt"), "mine").unwrap();
    for (light, more) in [("a1", &[][..]), ("a2", &["--force"])] {
        let told = String::from_utf8(cut(light, more).success().get_output().stdout.clone()).unwrap();
        assert!(told.contains(&format!("sumo-gui -c {}", out.join("cut.sumocfg").display())), "{told}");
        assert_eq!(Node::read(&out.join("cut.net.xml")).by_id("tlLogic").keys().next(), Some(&light));
    }
    let names = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    // The files of the first light that differ stand beside those of the second one, under other names.
    let (before, names): (BTreeSet<_>, BTreeSet<_>) = names.partition(|name| name.contains(".old-"));
    let expected = ["cut.net.xml", "cut.rou.xml", "cut.sumocfg", "cut.types.add.xml", "mine.txt"];
    assert_eq!(names, expected.map(Into::into).into());
    assert!(before.iter().any(|name| name.starts_with("cut.net.xml")), "{before:?}");
    fs::write(room.path().join("config.toml"), "").unwrap();
    fs::write(room.path().join("run.json"), "").unwrap();
    let into_run = ["nets", "cut", text(&arterial), "--light", "a1", "--out", text(&room.path().join("networks"))]
        .map(str::to_owned);
    let refused = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic").args(into_run).assert().code(2);
    assert!(String::from_utf8_lossy(&refused.get_output().stderr).contains("--out must not write here"));
}

/// Lights of real networks, which are not part of this program.
#[test]
fn every_light_of_real_networks_can_be_cut_out_as_it_is() {
    let Some(folder) = std::env::var_os("DIALS_NETWORKS").map(PathBuf::from) else {
        // Not `eprintln`, which is hidden when a test passes.
        let line = "not tested: cuts of real networks: DIALS_NETWORKS names no folder with them\n";
        stderr().write_all(line.as_bytes()).unwrap();
        return;
    };
    let mut found = [(0, 0); 3];
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap()).filter(|entry| entry.path().is_dir()) {
        let scenario = entry.path().join(entry.file_name()).with_extension("sumocfg");
        for (hops, (lights, brakings)) in [0, 1, 3].into_iter().zip(&mut found) {
            let (more_lights, more_brakings) = check(&scenario, Reach { hops, metres: 150.0 });
            *lights += more_lights;
            *brakings += more_brakings;
        }
    }
    let line = format!("real networks: (lights cut, equal and loaded in silence; hard brakings) {found:?}\n");
    stderr().write_all(line.as_bytes()).unwrap();
    assert!(found[0].0 > 0, "the folder has scenarios");
}
