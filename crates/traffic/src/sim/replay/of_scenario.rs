//! The replay of a scenario: its own files with the seed of the episode, and the recorded lights.

use std::collections::HashSet;

use super::{NAME, Program, SIGNALS, VIEW, programs, shown};
use crate::cut::names::free_name;
use crate::network::tree::Element;
use crate::scenario::SumoScenario;
use crate::scenario::kept::Episode;
use crate::sim::recording::Recording;

/// Returns the files of the replay without signals and view: names and contents.
pub fn files(recording: &Recording, files: &SumoScenario) -> Vec<(String, Vec<u8>)> {
    let end_s = recording.roads.begin_s() + recording.steps.len() as u64;
    let episode = Episode { seed: recording.seed, end_s, signals: SIGNALS, view: VIEW };
    files.episode_files(NAME, &episode)
}

/// Returns a program for each of the first `lights` recorded lights. `roots`: of the files with their other programs.
pub fn signals<'a>(recording: &Recording, lights: usize, roots: impl Iterator<Item = &'a Element>) -> String {
    let taken: HashSet<(&str, &str)> = roots
        .flat_map(|root| root.all("tlLogic"))
        .filter_map(|program| Some((program.attribute("id")?, program.attribute("programID")?)))
        .collect();
    let recorded = recording.roads.lights.iter().take(lights).enumerate().map(|(number, light)| Program {
        light,
        // A scenario may be a replay itself.
        name: free_name("recorded", |name| taken.contains(&(light, name))),
        shown: shown(recording, number),
    });
    programs(recorded, recording.roads.begin_s())
}
