//! Files that users write: configs with `--set`, files of fixed-time lights, experiments.

use std::collections::BTreeSet;
use std::path::{Component, Path};

use anyhow::{Result, ensure};
use dials_core::domain::{RoughCosts, Scenario};
use dials_core::outside::is_printable;
use dials_session::config::RunConfig;
use dials_session::experiment::file::{Experiment, Knowledge};
use dials_session::records::find::MeasuredWith;
use dials_traffic::config::TrafficConfig;
use dials_traffic::controllers::timing_file::{Score, TimingFile};
use dials_traffic::paper_grid::grid::Grid;
use dials_traffic::paper_grid::plans::plans;

use super::place::Place;
use super::read_all;

/// Lines that begin so hold a setting of the command line.
const SET: &str = "#set ";
const SETTINGS: &[u8] = b"total_steps = 4000
#set seed=18446744073709551615
#set ppo.clip = 0.2
#set policy.hidden=[8, 4]
#set simulator=gs
#set warehouse.horizon=7
#set numerics.vector_width=256-bit
[warehouse]
agents_per_side = 2
";

pub(crate) fn config_seeds(_: &Place) -> Vec<Vec<u8>> {
    let files = ["configs/smoke_traffic.toml", "configs/smoke_warehouse.toml", "configs/traffic_4.toml"];
    [read_all(&files), vec![SETTINGS.into()]].concat()
}

/// An accepted config comes back equal from its own text, and from the form in which workers get it.
pub(crate) fn config(place: &Place, bytes: &[u8]) -> Result<()> {
    let text = String::from_utf8_lossy(bytes);
    let settings: Vec<String> = text.lines().filter_map(|line| line.strip_prefix(SET)).map(str::to_owned).collect();
    let config = dials_session::config::load(&place.file("config.toml", bytes), &settings)?;
    let text = dials_session::config::to_toml(&config).expect("an accepted config can be written");
    let read = dials_session::config::load(&place.file("again.toml", text.as_bytes()), &[]);
    assert!(read.expect("it was written by us") == config, "it is read again as another config:\n{text}");
    let json = serde_json::to_string(&config).expect("an accepted config can be sent");
    let sent: RunConfig = serde_json::from_str(&json).expect("it was written by us");
    assert!(sent == config, "workers get another config:\n{json}");
    let last = dials_learn::config::schedule(&config.learning).last().map_or(0, |last| last.end);
    let ends = [last, config.learning.last_step()].map(|step| config.learning.update_at_or_after(step));
    assert_eq!(ends[0], ends[1], "its periods end elsewhere:\n{text}");
    Ok(())
}

const TIMINGS: &str = "vertical = 9
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

pub(crate) fn timings_seeds(_: &Place) -> Vec<Vec<u8>> {
    let coordinated = TIMINGS.replace("fixed-time", "coordinated");
    vec![TIMINGS.into(), coordinated.replace("mean_return", "early = 3\nlate = 2\nmean_return").into()]
}

/// Accepted timings have an answer for every step, finite figures, and come back from their own text.
pub(crate) fn timings(place: &Place, bytes: &[u8]) -> Result<()> {
    let path = place.file("timings.toml", bytes);
    let lights = plans(Grid::new(2, 2).expect("a small grid"), &TrafficConfig::new("", ""));
    let plan = |controller| TimingFile::plan(&path, controller, &lights);
    for timing in &plan("fixed-time").or_else(|_| plan("coordinated"))?.timings {
        // More steps than the longest episode has.
        for step in (0..=1_000_000).step_by(99_991) {
            std::hint::black_box((timing.target(step), timing.until_change(step), timing.since_change(step)));
        }
    }
    let file = TimingFile::read(&path).expect("it was just read");
    let (Score::Return(mean) | Score::DelaySeconds(mean)) = file.score();
    assert!(mean.is_finite(), "its score is {mean}");
    place.file("timings.toml", file.to_toml().expect("accepted timings can be written").as_bytes());
    assert!(TimingFile::read(&path).expect("it was written by us") == file, "it is read again as another file");
    Ok(())
}

const EXPERIMENT: &[u8] = b"seeds = [1, 2]
set = ['total_steps=1000']
controllers = ['random', 'fixed-time:file=a/b.toml']
controller_episodes = 7
all_cores_from_agents = 9

[[grid]]
configs = ['small.toml', 'large.toml']
simulators = ['gs', 'dials']
retrain_every_steps = [200, 500]
name = 'word'

[[grid]]
configs = ['small.toml']
seeds = [3]
set = ['ppo.clip=0.2']
";
const KNOWLEDGE: Knowledge = Knowledge {
    simulated: &|config| Ok((Scenario::new("warehouse", 4, config.horizon()), RoughCosts::default())),
    controller: &|_, name| {
        let known = ["random", "oldest-item", "closest-item", "fixed-time"];
        ensure!(name.split(':').next().is_some_and(|word| known.contains(&word)), "controller `{name}`: unknown");
        Ok(MeasuredWith::default())
    },
};

pub(crate) fn experiment_seeds(_: &Place) -> Vec<Vec<u8>> {
    vec![EXPERIMENT.into()]
}

/// The runs and baselines of an accepted experiment have different names, each of one folder or file.
pub(crate) fn experiment(place: &Place, bytes: &[u8]) -> Result<()> {
    place.empty("experiments");
    for name in ["small", "large"] {
        place.file(&format!("experiments/{name}.toml"), b"[warehouse]\nagents_per_side = 2\n");
    }
    let path = place.file("experiments/e.toml", bytes);
    let experiment = Experiment::read(&path, &KNOWLEDGE)?;
    let runs: Vec<&str> = experiment.runs.iter().map(|run| &*run.name).collect();
    let baselines: Vec<&str> = experiment.baselines.iter().map(|baseline| &*baseline.name).collect();
    for names in [runs, baselines] {
        assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "two have one name");
        for name in names {
            let mut parts = Path::new(name).components();
            let one = matches!((parts.next(), parts.next()), (Some(Component::Normal(part)), None) if part == name);
            assert!(one && name.chars().all(is_printable), "a name leads elsewhere or is not printable: {name:?}");
        }
    }
    Ok(())
}
