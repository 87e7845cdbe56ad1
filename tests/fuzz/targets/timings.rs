//! Files of timings, as `--controller fixed-time:file=PATH` and `--controller coordinated:file=PATH` read them.

use std::fs;

use dials_traffic::config::TrafficConfig;
use dials_traffic::controllers::timing_file::{Score, TimingFile};
use dials_traffic::paper_grid::grid::Grid;
use dials_traffic::paper_grid::plans::plans;

use crate::place::work;
use crate::verdict::Verdict;

const SEED: &str = "vertical = 9
horizontal = 11
offsets = [0, 13, 13, 0]
mean_return = 205.25

[tuned_on]
controller = \"fixed-time\"
network = \"grid_2x2\"
network_crc32 = \"0123abcd\"
horizon = 300
episodes = 10
seed = \"0\"
search_version = 1
sumo_version = \"SUMO 1.15.0\"
";

pub fn seeds() -> Vec<Vec<u8>> {
    let coordinated =
        SEED.replace("fixed-time", "coordinated").replace("mean_return", "early = 3\nlate = 2\nmean_return");
    vec![SEED.into(), coordinated.into()]
}

/// Accepted timings have an answer for every step, finite figures, and come back from their own text.
pub fn call(bytes: &[u8]) -> Verdict {
    let path = work().join("timings.toml");
    fs::write(&path, bytes).expect("a file to work with");
    let lights = plans(Grid::new(2, 2).expect("a small grid"), &TrafficConfig::new("", ""));
    let plan = |controller| TimingFile::plan(&path, controller, &lights);
    let plan = match plan("fixed-time").or_else(|_| plan("coordinated")) {
        Ok(plan) => plan,
        Err(error) => return Verdict::refused(error),
    };
    for timing in &plan.timings {
        // More steps than the longest episode has.
        for step in (0..=1_000_000).step_by(99_991) {
            std::hint::black_box((timing.target(step), timing.until_change(step), timing.since_change(step)));
        }
    }
    let file = TimingFile::read(&path).expect("it was just read");
    let (Score::Return(mean) | Score::DelaySeconds(mean)) = file.score();
    assert!(mean.is_finite(), "its score is {mean}");
    fs::write(&path, file.to_toml().expect("accepted timings can be written")).expect("a file to work with");
    assert!(TimingFile::read(&path).expect("it was written by us") == file, "it is read again as another file");
    Verdict::Accepted
}
