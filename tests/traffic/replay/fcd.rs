//! What plain SUMO plays from the folder of a replay, second by second, and what was recorded.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command as Program;

use dials_traffic::sim::recorded_roads::RecordedFiles;
use dials_traffic::sim::recording::Recording;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::text;
use crate::plain_sumo;

pub(super) fn attribute(tag: &BytesStart, name: &str) -> String {
    let attribute = tag.try_get_attribute(name).unwrap().unwrap_or_else(|| panic!("no {name}"));
    attribute.normalized_value(XmlVersion::Implicit1_0).unwrap().into_owned()
}

/// Sets of car, lane, position and speed.
pub(super) type Places = BTreeSet<(String, String, String)>;

/// Returns what plain `sumo` plays from a folder: for every step the cars with lane, position and speed as SUMO prints
/// them.
pub(super) fn sumo_plays(dir: &Path) -> Vec<Places> {
    let room = tempfile::tempdir().unwrap();
    let fcd = room.path().join("fcd.xml");
    let output = Program::new(plain_sumo())
        .args(["-c", "replay.sumocfg", "--no-step-log", "--precision", "15", "--fcd-output", text(&fcd)])
        .current_dir(dir)
        .env_remove("SUMO_HOME")
        .output()
        .expect("Debian's package sumo is installed");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    let xml = fs::read_to_string(&fcd).unwrap();
    let mut reader = Reader::from_str(&xml);
    let mut steps = Vec::new();
    loop {
        match reader.read_event().unwrap() {
            Event::Start(tag) | Event::Empty(tag) => match tag.name().as_ref() {
                "timestep" => steps.push(Places::new()),
                "vehicle" => {
                    let [id, lane, position, speed] = ["id", "lane", "pos", "speed"].map(|name| attribute(&tag, name));
                    steps.last_mut().unwrap().insert((id, lane, format!("{position} {speed}")));
                }
                _ => {}
            },
            Event::Eof => return steps,
            _ => {}
        }
    }
}

/// Returns the same of a recording, with 15 digits after the point, correctly rounded like SUMO's.
fn was(recording: &Recording) -> Vec<Places> {
    let names: BTreeMap<_, _> = recording.entries.iter().map(|entry| (entry.car.id, entry.car.name.clone())).collect();
    let lanes = &recording.roads.lanes;
    let steps = recording.steps.iter().map(|step| {
        let cars = step.cars.iter().zip(lanes).flat_map(|(cars, lane)| cars.iter().map(move |car| (car, lane)));
        let cars = cars.map(|(car, lane)| {
            (names[&car.id].clone(), lane.clone(), format!("{:.15} {:.15}", car.position_m, car.speed_mps))
        });
        cars.collect()
    });
    steps.collect()
}

/// Returns the number of seconds that a replay plays before the episode, on a road apart from the others.
fn seconds_before(recording: &Recording) -> usize {
    match &recording.roads.files {
        RecordedFiles::Grid(_) | RecordedFiles::Whole(_) => 0,
        RecordedFiles::Local(files) => files.begin_s() as usize,
    }
}

/// Asserts that plain SUMO plays the folder as it was recorded. Returns the number of compared places of cars.
pub(super) fn assert_same(dir: &Path, recording: &Recording) -> usize {
    let (mut played, was) = (sumo_plays(dir), was(recording));
    let before = played.drain(..seconds_before(recording)).flatten();
    before.for_each(|(_, lane, _)| assert_eq!(lane, "apart_0"));
    played.iter_mut().for_each(|cars| cars.retain(|(_, lane, _)| lane != "apart_0"));
    assert_eq!(played.len(), was.len(), "steps");
    for (step, (played, was)) in played.iter().zip(&was).enumerate() {
        let differences: Vec<_> = played.symmetric_difference(was).collect();
        assert!(differences.is_empty(), "step {step}: {differences:?}");
    }
    was.iter().map(BTreeSet::len).sum()
}
