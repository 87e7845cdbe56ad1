//! Dependencies between the crates of this workspace go one way: down the list.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

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
