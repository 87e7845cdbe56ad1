//! Dependencies between the crates of this workspace go one way: down the list.

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
