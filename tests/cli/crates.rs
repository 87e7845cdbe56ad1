//! Dependencies between the crates of this workspace go one way: down the list.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

/// All crates, the lowest first. A crate may depend on those before it.
const ORDER: [&str; 10] = [
    "libsumo",
    "stacknets",
    "dials-core",
    "dials-learn",
    "dials-traffic-domain",
    "dials-warehouse-domain",
    "dials-session",
    "dials-report",
    "dials-traffic",
    "dials-traffic-python",
];

/// Pairs of crates with an arrow down the list that must not be there.
const FORBIDDEN: [(&str, &str); 5] = [
    ("dials-core", "libsumo"),
    ("dials-learn", "libsumo"),
    ("dials-session", "libsumo"),
    ("dials-traffic-domain", "dials-learn"),
    ("dials-warehouse-domain", "dials-learn"),
];

fn manifest(folder: &Path) -> toml::Table {
    fs::read_to_string(folder.join("Cargo.toml")).unwrap().parse().unwrap()
}

#[test]
fn no_crate_depends_on_one_above_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let crates = fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let mut seen = 0;
    for folder in crates.chain([root.to_owned(), root.join("python")]) {
        let manifest = manifest(&folder);
        let name = manifest["package"]["name"].as_str().unwrap();
        let Some(place) = ORDER.iter().position(|&other| other == name) else {
            assert_eq!(name, "dials-testkit", "{name} has no place in the order");
            continue;
        };
        seen += 1;
        for other in manifest["dependencies"].as_table().unwrap().keys() {
            let below = ORDER.iter().position(|name| name == other).is_none_or(|other| other < place);
            assert!(below, "{name} depends on {other}, which is above it");
            assert!(!FORBIDDEN.contains(&(name, other.as_str())), "{name} must not depend on {other}");
        }
    }
    assert_eq!(seen, ORDER.len());
}

#[test]
fn only_tests_depend_on_the_testkit() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for entry in fs::read_dir(root.join("crates")).unwrap() {
        let manifest = manifest(&entry.unwrap().path());
        assert!(!manifest["dependencies"].as_table().unwrap().contains_key("dials-testkit"), "{manifest}");
    }
}

/// Returns the words in backticks.
fn code_words(text: &str) -> BTreeSet<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

#[test]
fn the_table_of_the_docs_has_every_crate_and_what_it_uses() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/architecture.md")).unwrap();
    let folders = fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let manifests: BTreeMap<String, toml::Table> =
        folders.map(|folder| (folder.file_name().unwrap().to_str().unwrap().to_owned(), manifest(&folder))).collect();
    let folder_of = |name: &str| {
        let its = |manifest: &toml::Table| manifest["package"]["name"].as_str() == Some(name);
        manifests.iter().find(|(_, manifest)| its(manifest)).map(|(folder, _)| folder.as_str())
    };
    for (folder, manifest) in &manifests {
        let row = page.lines().find(|line| line.starts_with(&format!("| `{folder}` | ")));
        let row = row.unwrap_or_else(|| panic!("docs/architecture.md has no row for {folder}"));
        let may_use = code_words(row.rsplit(" | ").next().unwrap());
        for used in manifest["dependencies"].as_table().unwrap().keys().filter_map(|name| folder_of(name)) {
            assert!(may_use.contains(used), "{folder} uses {used}, but docs/architecture.md says: {may_use:?}");
        }
    }
}

/// Returns the features of each crate that this one is built from, by name and version.
fn features(of: &str) -> BTreeMap<String, String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let args = ["tree", "--locked", "--offline", "-p", of, "-e", "normal,build", "--prefix", "none", "-f", "{p}|{f}"];
    let output = Command::new(cargo).args(args).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let tree = String::from_utf8(output.stdout).unwrap();
    tree.lines()
        .map(|line| line.trim_end_matches(" (*)").split_once('|').unwrap())
        .map(|(name, features)| (name.to_owned(), features.to_owned()))
        .collect()
}

/// With other features a crate is built once more for the wheel, and all that depend on it.
#[test]
fn the_wheel_is_built_from_the_crates_of_the_program() {
    let (program, wheel) = (features("dials-traffic"), features("dials-traffic-python"));
    let shared: Vec<_> = program.iter().filter(|(name, _)| wheel.contains_key(*name)).collect();
    assert!(shared.len() > 50, "{}", shared.len());
    for (name, features) in shared {
        assert_eq!(wheel[name], *features, "{name}: make its features equal, in Cargo.toml and in python/Cargo.toml");
    }
}
