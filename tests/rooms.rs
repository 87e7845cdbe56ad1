//! Each room may use only certain other rooms.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Rooms that a room may use, besides itself. `run` (with `main`, `cli` and `error`) may use all.
const DOORS: &[(&str, &[&str])] = &[
    ("base", &[]),
    ("config", &["base"]),
    ("domain", &["base"]),
    ("sumo", &["base"]),
    ("nn", &["base"]),
    ("traffic", &["base", "config", "domain", "sumo"]),
    ("warehouse", &["base", "config", "domain"]),
    ("drawing", &[]),
    ("plot", &["base", "domain", "drawing"]),
    ("influence", &["base", "config", "domain", "nn"]),
    ("policy", &["base", "config", "domain", "nn"]),
    ("evaluation", &["base", "domain", "policy"]),
    ("training", &["base", "config", "domain", "nn", "influence", "policy", "evaluation"]),
    ("fleet", &["base", "config", "domain", "nn", "evaluation", "influence", "policy", "training"]),
    ("records", &["base", "config", "domain", "nn", "evaluation", "influence", "policy", "training"]),
    ("terminal", &["base", "config", "evaluation", "influence", "training"]),
    ("film", &["domain", "terminal"]),
    ("cost", &["config"]),
    ("bench", &["base", "config", "cost", "domain", "nn", "influence", "policy", "training"]),
    ("report", &["base", "config", "domain", "drawing", "records"]),
    ("experiment", &["config", "cost", "domain", "records", "report"]),
];

/// Outside crates that only some rooms may use.
const OUTSIDE: &[(&str, &[&str])] = &[
    ("tch", &["nn"]),
    ("gemm", &["nn"]),
    ("gemm_common", &["nn"]),
    ("gemm_f32", &["nn"]),
    ("pulp", &["nn"]),
    ("rayon", &["nn"]),
    ("quick_xml", &["traffic"]),
    ("roxmltree", &["traffic"]),
    ("clap", &["cli", "run", "main"]),
    ("indicatif", &["terminal"]),
    ("signal_hook", &["terminal"]),
    ("gif", &["film"]),
    ("png", &["film"]),
    ("plotters", &["drawing", "plot", "report"]),
    ("statrs", &["base"]),
];

const TOP: &[&str] = &["run", "cli", "error", "main", "lib"];

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
        let code = text.split("#[cfg(test)]").next().unwrap();
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
    assert!(names["training"].contains("influence"), "the search for `use crate::` lines finds nothing: {names:?}");
    for (room, used) in names {
        if TOP.contains(&room.as_str()) {
            continue;
        }
        let doors = DOORS.iter().find(|(name, _)| *name == room);
        let (_, doors) = doors.unwrap_or_else(|| panic!("src/{room} is a new room: add it to DOORS"));
        for name in used {
            if let Some((_, rooms)) = OUTSIDE.iter().find(|(outside, _)| *outside == name) {
                assert!(rooms.contains(&room.as_str()), "src/{room} uses {name}, which only {rooms:?} may");
            } else {
                assert!(
                    name == room || doors.contains(&name.as_str()),
                    "src/{room} uses {name}, but may only use {doors:?}"
                );
            }
        }
    }
}

/// A new domain needs only its own folder, its table in `config` and its line in `run/domain.rs`. The paper's numbers
/// are about two domains, so their file may name them.
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
        let code = text.split("#[cfg(test)]").next().unwrap();
        for name in
            ["DomainConfig::Traffic", "DomainConfig::Warehouse", "\"traffic\"", "\"warehouse\"", "crate::warehouse"]
        {
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
fn unsafe_code_lives_in_two_places() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for file in source_files(&src) {
        let text = fs::read_to_string(&file).unwrap();
        let within = file.strip_prefix(&src).unwrap();
        if text.contains("unsafe {") && !within.starts_with("sumo") {
            assert_eq!(within, Path::new("nn/product.rs"), "unsafe code outside its rooms");
        }
    }
}
