//! The replay of a scenario: its own files with the seed of the episode, and the recorded lights.

use std::collections::HashSet;

use super::{NAME, Program, SIGNALS, VIEW, programs, shown};
use crate::traffic::scenario::kept::Episode;
use crate::traffic::sim::recorded_roads::RecordedScenario;
use crate::traffic::sim::recording::Recording;

/// Returns the files of the replay without signals and view: names and contents.
pub fn files(recording: &Recording, scenario: &RecordedScenario) -> Vec<(String, Vec<u8>)> {
    let end_s = recording.roads.begin_s() + recording.steps.len() as u64;
    let episode = Episode { seed: recording.seed, end_s, signals: SIGNALS, view: VIEW };
    scenario.files.episode_files(NAME, &episode)
}

/// Returns one program per light that learns. The others run the programs that they ran.
pub fn signals(recording: &Recording, scenario: &RecordedScenario) -> String {
    let files = [scenario.files.net()].into_iter().chain(scenario.files.additional());
    let taken: HashSet<(&str, &str)> = files
        .flat_map(|root| root.all("tlLogic"))
        .filter_map(|program| Some((program.attribute("id")?, program.attribute("programID")?)))
        .collect();
    let of_agents = recording.roads.lights.iter().take(scenario.agents.len()).enumerate();
    let recorded = of_agents.map(|(number, light)| Program {
        light,
        name: free_name(|name| taken.contains(&(light, name))),
        shown: shown(recording, number),
    });
    programs(recorded, recording.roads.begin_s())
}

/// Returns a name that is not taken. A scenario may be a replay itself.
fn free_name(is_taken: impl Fn(&str) -> bool) -> String {
    let numbered = (2..).map(|number| format!("recorded_{number}"));
    let mut names = ["recorded".to_owned()].into_iter().chain(numbered);
    names.find(|name| !is_taken(name)).expect("numbers go on")
}
