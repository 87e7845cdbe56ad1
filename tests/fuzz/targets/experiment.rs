//! Experiment files, with configs beside them.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path};

use anyhow::ensure;
use dials_core::domain::{RoughCosts, Scenario};
use dials_core::outside::is_printable;
use dials_session::experiment::file::{Experiment, Knowledge};
use dials_session::records::find::MeasuredWith;

use super::read_all;
use crate::place::{empty, work};
use crate::verdict::Verdict;

const SMALL: &str = "seeds = [1, 2]
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

pub fn seeds() -> Vec<Vec<u8>> {
    let files = ["experiments/full_warehouse.toml", "experiments/figures_warehouse.toml"];
    read_all(&files).into_iter().chain([SMALL.into()]).collect()
}

/// The runs and baselines of an accepted experiment have different names, each of one folder or file.
pub fn call(bytes: &[u8]) -> Verdict {
    if !work().join("configs").is_dir() {
        let configs = empty("configs");
        for name in ["warehouse_4", "warehouse_25", "warehouse_49", "warehouse_100", "smoke_warehouse"] {
            let [text] = &read_all(&[&format!("configs/{name}.toml")])[..] else { unreachable!("one file") };
            fs::write(configs.join(format!("{name}.toml")), text).expect("a file to work with");
        }
    }
    let folder = empty("experiments");
    for name in ["small", "large"] {
        fs::write(folder.join(format!("{name}.toml")), "[warehouse]\nagents_per_side = 2\n").expect("a new file");
    }
    let path = folder.join("e.toml");
    fs::write(&path, bytes).expect("a file to work with");
    let experiment = match Experiment::read(&path, &KNOWLEDGE) {
        Ok(experiment) => experiment,
        Err(error) => return Verdict::refused(error),
    };
    let runs: Vec<&str> = experiment.runs.iter().map(|run| &*run.name).collect();
    let baselines: Vec<&str> = experiment.baselines.iter().map(|baseline| &*baseline.name).collect();
    for names in [runs, baselines] {
        names.iter().for_each(|name| check_name(name));
        assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "two have one name");
    }
    Verdict::Accepted
}

fn check_name(name: &str) {
    let mut parts = Path::new(name).components();
    let one = matches!((parts.next(), parts.next()), (Some(Component::Normal(part)), None) if part == name);
    assert!(one, "a name leads elsewhere: {name:?}");
    assert!(name.chars().all(is_printable), "a name is not printable: {name:?}");
}
