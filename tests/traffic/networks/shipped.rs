//! The shipped scenarios: made again they are the same, they run on plain SUMO, and their lights are safe.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::{elements, elements_of, room, sumo, text};

pub(super) const SCENARIOS: [&str; 3] = ["grid_4x4_turns", "town", "arterial"];
/// All that `make.py` makes without arguments. An hour of the city is too long to play in a test.
const MADE: [&str; 4] = ["grid_4x4_turns", "town", "arterial", "city_60"];
/// Seeds of SUMO for the figures of `sumo_nets/README.md`.
const SEEDS: [&str; 2] = ["1", "2"];

fn nets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets")
}

pub(super) fn file(scenario: &str, ending: &str) -> PathBuf {
    nets().join(scenario).join(format!("{scenario}.{ending}"))
}

#[test]
fn making_the_shipped_scenarios_again_gives_the_same_files_byte_for_byte() {
    let room = room();
    let made = Command::new("python3").arg(nets().join("make.py")).arg(room.path()).output();
    let made = made.expect("Debian's package python3 is installed");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    for scenario in MADE {
        let names = |folder: PathBuf| -> BTreeSet<_> {
            fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("a file").file_name()).collect()
        };
        let (saved, made) = (nets().join(scenario), room.path().join(scenario));
        assert_eq!(names(saved.clone()), names(made.clone()));
        for name in names(saved.clone()) {
            let same = fs::read(saved.join(&name)).expect("a file") == fs::read(made.join(&name)).expect("a file");
            assert!(same, "{scenario}: {name:?}: remake it with: python3 sumo_nets/make.py");
        }
    }
}

#[test]
fn a_drawn_scenario_has_the_lights_that_were_asked_for_and_the_same_bytes_for_a_seed_and_plays_without_a_warning() {
    for (kind, option) in [("city", "--lights"), ("towns", "--junctions")] {
        let room = room();
        let made = |folder: &str, seed: &str| -> PathBuf {
            let folder = room.path().join(folder);
            let made = Command::new("python3")
                .arg(nets().join("make.py"))
                .args([kind, option, "20", "--seed", seed])
                .arg(&folder)
                .output()
                .expect("Debian's package python3 is installed");
            assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
            folder.join(kind)
        };
        let [one, again, other] = [("one", "3"), ("again", "3"), ("other", "4")].map(|(name, seed)| made(name, seed));
        for ending in ["net.xml", "rou.xml"] {
            let [one, again, other] =
                [&one, &again, &other].map(|files| fs::read(files.with_extension(ending)).expect("a file"));
            assert!(one == again, "{kind}: {ending}: the same seed");
            assert!(one != other, "{kind}: {ending}: another seed");
        }
        assert_eq!(elements(&one.with_extension("net.xml"), "tlLogic").len(), 20, "{kind}");
        let said = sumo(&["-c", text(&one.with_extension("sumocfg")), "--end", "300", "--no-step-log"]);
        // Where people come from two sides, some stand in each other's way, until SUMO lets them pass.
        let warnings: Vec<&str> = said.lines().filter(|line| !line.contains("is jammed on edge")).collect();
        assert!(warnings.is_empty(), "{kind}: {warnings:?}");
    }
}

/// What one hour of plain SUMO with the scenario's own programs shows.
struct Hour {
    vehicles: f64,
    delay_s: f64,
}

fn number(text: &str) -> f64 {
    text.parse().unwrap_or_else(|_| panic!("{text}: not a number"))
}

/// Plays a scenario. Delay is the time lost under way and before departure, over all vehicles, finished or not.
fn play(scenario: &str, seed: &str) -> Hour {
    let room = room();
    let (trips, totals) = (room.path().join("trips.xml"), room.path().join("totals.xml"));
    let config = file(scenario, "sumocfg");
    let said = sumo(&[
        "-c",
        text(&config),
        "--seed",
        seed,
        "--no-step-log",
        "--time-to-teleport",
        "300",
        "--tripinfo-output",
        text(&trips),
        "--tripinfo-output.write-unfinished",
        "--statistic-output",
        text(&totals),
    ]);
    assert_eq!(said, "", "{scenario}: SUMO has nothing to warn of");
    let total = |kind: &str, key: &str| number(&elements(&totals, kind)[0][key]);
    assert_eq!(total("teleports", "total"), 0.0, "{scenario}: nobody stands for five minutes");
    assert_eq!((total("safety", "collisions"), total("safety", "emergencyStops")), (0.0, 0.0), "{scenario}");
    assert_eq!(total("vehicles", "waiting"), 0.0, "{scenario}: everybody could enter by the end");
    let trips = elements(&trips, "tripinfo");
    let lost: f64 = trips.iter().map(|trip| number(&trip["timeLoss"]) + number(&trip["departDelay"])).sum();
    Hour { vehicles: trips.len() as f64, delay_s: lost / trips.len() as f64 }
}

/// Returns the text of an element of a network with all that it holds.
fn block(net: &str, kind: &str, id: &str) -> String {
    let (_, rest) = net.split_once(&format!("<{kind} id=\"{id}\"")).expect("the element is there");
    let (inner, _) = rest.split_once(&format!("</{kind}>")).expect("the element ends");
    format!("<{kind}{inner}</{kind}>")
}

/// Returns the letters of all phases of a light, in their order.
fn states(net: &str, light: &str) -> Vec<Vec<u8>> {
    let phases = elements_of(&block(net, "tlLogic", light), "phase");
    phases.into_iter().map(|mut phase| phase.remove("state").expect("a state").into_bytes()).collect()
}

fn goes(letter: u8) -> bool {
    letter.eq_ignore_ascii_case(&b'g')
}

/// Returns the different greens of a light: phases in which somebody goes and nobody is yellow.
fn greens(net: &str, light: &str) -> BTreeSet<Vec<u8>> {
    states(net, light).into_iter().filter(|state| !state.contains(&b'y') && state.iter().any(|x| goes(*x))).collect()
}

#[test]
fn the_readme_has_the_figures_of_every_shipped_scenario() {
    let readme = fs::read_to_string(nets().join("README.md")).expect("the page is there");
    for scenario in SCENARIOS {
        let hours = SEEDS.map(|seed| play(scenario, seed));
        let mean = |figure: fn(&Hour) -> f64| hours.iter().map(figure).sum::<f64>() / hours.len() as f64;
        let delay_s = mean(|hour| hour.delay_s);
        assert!((25.0..=120.0).contains(&delay_s), "{scenario}: {delay_s} s: something to win, but no gridlock");

        let net = fs::read_to_string(file(scenario, "net.xml")).expect("a network");
        let lights: Vec<String> =
            elements_of(&net, "tlLogic").into_iter().map(|mut light| light.remove("id").expect("an id")).collect();
        let lanes = |light: &String| {
            let links = elements_of(&net, "connection").into_iter().filter(|link| link.get("tl") == Some(light));
            links.map(|link| (link["from"].clone(), link["fromLane"].clone())).collect::<BTreeSet<_>>().len()
        };
        let from_to = |counts: Vec<usize>| {
            let (least, most) = (counts.iter().min().expect("lights"), counts.iter().max().expect("lights"));
            if least == most { least.to_string() } else { format!("{least} to {most}") }
        };
        let row = format!(
            "| `{scenario}` | {} | {} | {} | {:.0} | {delay_s:.0} |",
            lights.len(),
            from_to(lights.iter().map(|light| greens(&net, light).len()).collect()),
            from_to(lights.iter().map(lanes).collect()),
            mean(|hour| hour.vehicles),
        );
        assert!(readme.contains(&row), "sumo_nets/README.md lacks the row: {row}");
    }
}

#[test]
fn the_programs_of_the_shipped_scenarios_serve_everybody_and_let_no_foes_go_at_once() {
    for scenario in SCENARIOS {
        let net = fs::read_to_string(file(scenario, "net.xml")).expect("a network");
        for program in elements_of(&net, "tlLogic") {
            let light = &program["id"];
            assert_eq!(program["type"], "static", "{scenario} {light}");
            let greens = greens(&net, light);
            assert!(greens.len() >= 2, "{scenario} {light}: something to choose");
            // SUMO writes the foes of a link from right to left.
            let foes: Vec<Vec<u8>> = elements_of(&block(&net, "junction", light), "request")
                .iter()
                .map(|request| request["foes"].bytes().rev().collect())
                .collect();
            let everybody = 0..foes.len();
            assert!(everybody.clone().all(|link| greens.iter().any(|green| goes(green[link]))), "{scenario} {light}");
            for green in &greens {
                let first: Vec<usize> = everybody.clone().filter(|link| green[*link] == b'G').collect();
                let meet = first.iter().any(|one| first.iter().any(|other| foes[*one][*other] == b'1'));
                assert!(!meet, "{scenario} {light}: {}", String::from_utf8_lossy(green));
            }
            let states = states(&net, light);
            for (now, next) in states.iter().zip(states.iter().cycle().skip(1)) {
                let falls = now.iter().zip(next).any(|(now, next)| goes(*now) && *next == b'r');
                assert!(!falls, "{scenario} {light}: red comes after yellow");
            }
        }
    }
}
