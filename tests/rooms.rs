//! Each room may use only certain other rooms.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Rows of the table of rooms in docs/architecture.md: a room, and the rooms that it may use beside itself. Rooms of the
/// row that may use all are left out.
fn doors() -> Vec<(String, BTreeSet<String>)> {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/architecture.md")).unwrap();
    let (_, table) = page.split_once("| room | what it holds | may use |\n").expect("the table of rooms");
    let rows = table.lines().skip(1).take_while(|line| line.starts_with('|'));
    let cells = rows.map(|row| row.trim_matches('|').split(" | ").map(str::trim).collect::<Vec<_>>());
    let names = |cell: &str| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<String>>();
    let rooms = cells.filter(|cells| cells[2] != "all").map(|cells| {
        let [room] = &names(cells[0])[..] else { panic!("a row is of one room: {cells:?}") };
        (room.clone(), names(cells[2]).into_iter().collect())
    });
    rooms.collect()
}

/// Outside crates that only some rooms may use.
const OUTSIDE: &[(&str, &[&str])] = &[
    ("tch", &["nn"]),
    ("gemm_common", &["nn"]),
    ("gemm_f32", &["nn"]),
    ("pulp", &["nn"]),
    ("rayon", &["nn"]),
    ("quick_xml", &["traffic"]),
    ("roxmltree", &["outside", "traffic"]),
    ("flate2", &["outside"]),
    ("clap", &["cli", "run", "main"]),
    ("clap_complete", &["cli", "run"]),
    ("clap_mangen", &["run"]),
    ("indicatif", &["terminal"]),
    ("signal_hook", &["terminal", "machine"]),
    ("gif", &["film"]),
    ("png", &["film"]),
    ("plotters", &["drawing", "plot", "report"]),
    ("statrs", &["base"]),
    ("mpi", &["fleet"]),
    ("tiny_http", &["live"]),
];

const TOP: &[&str] = &["run", "cli", "error", "main", "lib"];

/// Returns a file's text without its tests.
fn code_of(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests").next().expect("a text has a first part");
    let code = code.split("#[cfg(test)]\n#[cfg(feature").next().expect("a text has a first part");
    // Single items that only tests have, such as `mod threads;`.
    let mut kept = code.to_owned();
    while let Some(begin) = kept.find("#[cfg(test)]\n") {
        let line = begin + "#[cfg(test)]\n".len();
        let end = kept[line..].find('\n').map_or(kept.len(), |length| line + length + 1);
        kept.replace_range(begin..end, "");
    }
    kept
}

fn source_files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files = entries.flat_map(|path| if path.is_dir() { source_files(&path) } else { vec![path] });
    files.filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect()
}

/// Returns the names in each room's code: `crate::x` and outside crates, without the comments and tests of a file.
fn names_by_room() -> BTreeMap<String, BTreeSet<String>> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut names: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for file in source_files(&src) {
        let within = file.strip_prefix(&src).unwrap();
        let room = within.components().next().unwrap().as_os_str().to_string_lossy().replace(".rs", "");
        let text = fs::read_to_string(&file).unwrap();
        let code = code_of(&text);
        let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
        for line in lines {
            for (at, _) in line.match_indices("crate::") {
                let rest = &line[at + "crate::".len()..];
                let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                names.entry(room.clone()).or_default().insert(name);
            }
            for (outside, _) in OUTSIDE {
                let path = format!("{outside}::");
                let part_of_a_word = |at: usize| line[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
                if line.match_indices(&path).any(|(at, _)| !part_of_a_word(at)) {
                    names.entry(room.clone()).or_default().insert((*outside).to_owned());
                }
            }
        }
    }
    names
}

#[test]
fn every_room_opens_only_its_own_doors() {
    let names = names_by_room();
    assert!(names["training"].contains("influence"), "the reader of `use crate::` lines sees nothing: {names:?}");
    let all_doors = doors();
    for (place, (room, doors)) in all_doors.iter().enumerate() {
        let above = |door: &String| all_doors[..place].iter().any(|(other, _)| other == door);
        assert!(doors.iter().all(above), "{room} may use {doors:?}, which do not all stand above it");
    }
    for (room, used) in names {
        if TOP.contains(&room.as_str()) {
            continue;
        }
        let doors = all_doors.iter().find(|(name, _)| *name == room);
        let (_, doors) = doors.unwrap_or_else(|| panic!("src/{room} has no row in the table of docs/architecture.md"));
        for name in used {
            if let Some((_, rooms)) = OUTSIDE.iter().find(|(outside, _)| *outside == name) {
                assert!(rooms.contains(&room.as_str()), "src/{room} uses {name}, which only {rooms:?} may");
            } else {
                assert!(name == room || doors.contains(&name), "src/{room} opens {name}; its doors: {doors:?}");
            }
        }
    }
}

/// Every module that a room or a folder declares is named in its first comment.
#[test]
fn the_map_of_every_room_is_complete() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut maps = 0;
    let has_folder = |file: &Path| file.ends_with("mod.rs") || file.with_extension("").is_dir();
    for file in source_files(&src).into_iter().filter(|file| has_folder(file)) {
        let text = fs::read_to_string(&file).unwrap();
        let map: String = text.lines().filter(|line| line.starts_with("//!")).collect();
        let words: BTreeSet<&str> = map.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
        let declared = text.lines().filter_map(|line| {
            let line = line.strip_prefix("pub ").unwrap_or(line);
            line.strip_prefix("mod ")?.strip_suffix(';')
        });
        for module in declared {
            maps += 1;
            let place = file.strip_prefix(&src).unwrap().display();
            assert!(words.contains(module), "src/{place} declares `{module}`, and its first comment does not name it");
        }
    }
    assert!(maps > 100, "only {maps} modules were found");
}

/// A new domain is its own folder, its table in `config` and its line in `run/domain.rs`. The paper's numbers are of two
/// domains, so their file may name them.
#[test]
fn only_one_file_outside_config_and_the_domains_knows_a_domain_by_name() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let knowing = ["config", "traffic", "warehouse", "run/domain.rs", "report/paper.rs"];
    for file in source_files(&src) {
        let within = file.strip_prefix(&src).unwrap();
        if knowing.iter().any(|place| within.starts_with(place)) {
            continue;
        }
        let text = fs::read_to_string(&file).unwrap();
        let code = code_of(&text);
        for name in [
            "DomainConfig::Traffic",
            "DomainConfig::Scenario",
            "DomainConfig::Warehouse",
            "\"traffic\"",
            "\"warehouse\"",
            "crate::warehouse",
        ] {
            assert!(!code.contains(name), "src/{} names {name}", within.display());
        }
    }
}

#[test]
fn only_traffic_opens_sumo() {
    for (room, used) in names_by_room() {
        assert!(!used.contains("sumo") || ["traffic", "sumo"].contains(&room.as_str()), "src/{room} uses sumo");
    }
}

#[test]
fn unsafe_code_lives_in_three_places() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for file in source_files(&src) {
        let text = fs::read_to_string(&file).unwrap();
        let within = file.strip_prefix(&src).unwrap();
        if text.contains("unsafe {") && !within.starts_with("sumo") {
            let places = ["nn/product.rs", "machine/allocator.rs"].map(Path::new);
            assert!(places.contains(&within), "unsafe code outside its rooms: {}", within.display());
        }
    }
}
