//! The README keeps its promises about the code.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn read(path: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

/// All text under a folder.
fn texts(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| if path.is_dir() { texts(&path) } else { vec![fs::read_to_string(path).unwrap()] })
        .collect()
}

/// The number that a text begins with, where `after` follows it.
fn number_before(text: &str, after: &str) -> Option<u32> {
    text.split_once(after)?.0.parse().ok()
}

#[test]
fn every_departure_of_the_readme_is_marked_in_the_code_and_no_other() {
    let readme = read("README.md");
    let (_, list) = readme.split_once("## Departures from the paper\n").unwrap();
    let list = list.split("\n## ").next().unwrap();
    let told: Vec<u32> = list.lines().filter_map(|line| number_before(line, ". ")).collect();
    assert_eq!(told, (1..=told.len() as u32).collect::<Vec<_>>(), "they are numbered one by one");

    let code = texts(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src")).concat();
    let marks = code.split("DEVIATION").skip(1);
    let marked: BTreeSet<u32> = marks
        .map(|mark| {
            let number = mark.strip_prefix(' ').and_then(|rest| number_before(rest, ":"));
            number.unwrap_or_else(|| panic!("a mark without its number: DEVIATION{}", &mark[..mark.len().min(60)]))
        })
        .collect();
    assert_eq!(marked, told.into_iter().collect());
}
