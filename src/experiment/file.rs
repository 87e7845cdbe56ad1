//! The file of an experiment, and the runs that it means.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use serde::Deserialize;

use crate::config::{self, Config, SimulatorKind};
use crate::report::group::steps_text;
use crate::report::scenario::{Method, simulator};

/// A grid of runs.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExperimentFile {
    /// One run per seed of everything below, unless a grid has its own.
    pub seeds: Vec<u64>,
    /// Settings of all runs, as `train --set` takes them.
    #[serde(default)]
    pub set: Vec<String>,
    /// Hand-coded controllers to measure on every scenario, for the dashed lines of the report.
    #[serde(default)]
    pub controllers: Vec<String>,
    /// Episodes that each of them plays.
    #[serde(default = "default_controller_episodes")]
    pub controller_episodes: u32,
    /// Runs of fewer agents stand beside each other, one core each; larger ones have all cores to themselves.
    #[serde(default = "default_all_cores_from_agents")]
    pub all_cores_from_agents: usize,
    pub grid: Vec<Grid>,
}

/// All combinations of what it lists.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Config files, relative to the file of the experiment.
    pub configs: Vec<PathBuf>,
    /// Left out: the one that each config names.
    #[serde(default)]
    pub simulators: Vec<SimulatorKind>,
    /// F, for simulators whose AIPs are trained. Left out: what each config says.
    #[serde(default)]
    pub retrain_every_steps: Vec<u64>,
    #[serde(default)]
    pub seeds: Option<Vec<u64>>,
    /// Settings of these runs.
    #[serde(default)]
    pub set: Vec<String>,
    /// A word in the names of these runs.
    #[serde(default)]
    pub name: Option<String>,
}

fn default_controller_episodes() -> u32 {
    40
}

fn default_all_cores_from_agents() -> usize {
    25
}

/// A run that an experiment means to make.
#[derive(Clone, Debug)]
pub struct PlannedRun {
    /// Of its directory.
    pub name: String,
    pub config_path: PathBuf,
    /// What is laid over the config.
    pub settings: Vec<String>,
    pub config: Config,
    pub agents: usize,
}

/// A hand-coded controller that an experiment means to measure.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedBaseline {
    /// Of its file, without ending.
    pub name: String,
    pub config_path: PathBuf,
    pub controller: String,
    pub episodes: u32,
}

/// All that an experiment means to do.
#[derive(Debug)]
pub struct Experiment {
    pub baselines: Vec<PlannedBaseline>,
    pub runs: Vec<PlannedRun>,
    pub all_cores_from_agents: usize,
}

impl Experiment {
    /// Reads a file and checks every run of it; `agents` counts those of a config. A run that comes twice is made once.
    pub fn read(path: &Path, agents: &dyn Fn(&Config) -> Result<usize>) -> Result<Experiment> {
        let failed = || format!("{}: cannot be read", path.display());
        let text = std::fs::read_to_string(path).with_context(failed)?;
        let file: ExperimentFile = toml::from_str(&text).map_err(|error| anyhow!("{}: {error}", path.display()))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut experiment =
            Experiment { baselines: Vec::new(), runs: Vec::new(), all_cores_from_agents: file.all_cores_from_agents };
        ensure!(!file.grid.is_empty(), "{}: has no [[grid]], and so no runs", path.display());
        let mut stems: BTreeMap<String, PathBuf> = BTreeMap::new();
        for grid in &file.grid {
            ensure!(!grid.configs.is_empty(), "{}: a [[grid]] without configs has no runs", path.display());
            for config in &grid.configs {
                let config_path = folder.join(config);
                let stem = stem(&config_path);
                let known = stems.entry(stem.clone()).or_insert_with(|| config_path.clone());
                ensure!(
                    *known == config_path,
                    "{}: {} and {} have the same file name, by which runs are named",
                    path.display(),
                    known.display(),
                    config_path.display()
                );
                for controller in &file.controllers {
                    experiment.add_baseline(&config_path, controller, file.controller_episodes);
                }
                for run in combinations(&file, grid, &config_path, &stem) {
                    experiment.add_run(run, agents).with_context(|| format!("{}: a run of it", path.display()))?;
                }
            }
        }
        Ok(experiment)
    }

    fn add_baseline(&mut self, config_path: &Path, controller: &str, episodes: u32) {
        let (config_path, controller) = (config_path.to_owned(), controller.to_owned());
        let name = format!("{}-{controller}", stem(&config_path));
        let baseline = PlannedBaseline { name, config_path, controller, episodes };
        if !self.baselines.contains(&baseline) {
            self.baselines.push(baseline);
        }
    }

    fn add_run(&mut self, combination: Combination, agents: &dyn Fn(&Config) -> Result<usize>) -> Result<()> {
        let Combination { config_path, settings, words, seed } = combination;
        let config = config::load(&config_path, &settings)?;
        let name = format!("{}-{}{words}-seed{seed}", stem(&config_path), simulator(&config));
        if let Some(other) =
            self.runs.iter().find(|run| same_run(&run.config, &config) && run.config_path == config_path)
        {
            // An F that is the config's own, or a grid that overlaps another.
            debug_assert_eq!(other.config.seed, seed);
            return Ok(());
        }
        ensure!(
            self.runs.iter().all(|run| run.name != name),
            "two runs would be called {name}: give a [[grid]] a `name` of its own"
        );
        let agents = agents(&config)?;
        self.runs.push(PlannedRun { name, config_path, settings, config, agents });
        Ok(())
    }
}

struct Combination {
    config_path: PathBuf,
    settings: Vec<String>,
    /// Between simulator and seed in the name.
    words: String,
    seed: u64,
}

fn combinations(file: &ExperimentFile, grid: &Grid, config_path: &Path, stem: &str) -> Vec<Combination> {
    debug_assert!(!stem.is_empty());
    let one_of = |kinds: &[SimulatorKind]| -> Vec<Option<SimulatorKind>> {
        if kinds.is_empty() { vec![None] } else { kinds.iter().copied().map(Some).collect() }
    };
    let mut combinations = Vec::new();
    for kind in one_of(&grid.simulators) {
        let trained = !matches!(kind, Some(SimulatorKind::Gs | SimulatorKind::UntrainedDials));
        let every: Vec<Option<u64>> = match grid.retrain_every_steps.is_empty() || !trained {
            true => vec![None],
            false => grid.retrain_every_steps.iter().copied().map(Some).collect(),
        };
        for every in every {
            for &seed in grid.seeds.as_ref().unwrap_or(&file.seeds) {
                let mut settings: Vec<String> = file.set.iter().chain(&grid.set).cloned().collect();
                let kind = kind.map(|kind| toml::Value::try_from(kind).expect("a word"));
                settings.extend(kind.map(|kind| format!("simulator={}", kind.as_str().expect("a word"))));
                settings.extend(every.map(|every| format!("aip.retrain_every_steps={every}")));
                settings.push(format!("seed={seed}"));
                let mut words = every.map_or(String::new(), |every| format!("-F{}", steps_text(every)));
                words.extend(grid.name.iter().map(|name| format!("-{name}")));
                combinations.push(Combination { config_path: config_path.to_owned(), settings, words, seed });
            }
        }
    }
    combinations
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Whether two configs of one scenario make the same run.
pub fn same_run(a: &Config, b: &Config) -> bool {
    a.seed == b.seed && a.last_step() == b.last_step() && Method::of(a) == Method::of(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = "[warehouse]\nagents_per_side = 2\n";

    fn read(text: &str) -> Result<Experiment> {
        let dir = tempfile::tempdir().unwrap();
        for name in ["small", "large"] {
            std::fs::write(dir.path().join(format!("{name}.toml")), CONFIG).unwrap();
        }
        std::fs::write(dir.path().join("e.toml"), text).unwrap();
        Experiment::read(&dir.path().join("e.toml"), &|_| Ok(4))
    }

    fn names(text: &str) -> Vec<String> {
        read(text).unwrap().runs.into_iter().map(|run| run.name).collect()
    }

    #[test]
    fn a_grid_is_all_combinations_of_what_it_lists() {
        let names = names(
            "seeds = [1, 2]\n[[grid]]\nconfigs = ['small.toml']\nsimulators = ['gs', 'dials']\n\
             retrain_every_steps = [100000, 1000000]",
        );
        assert_eq!(
            names,
            [
                "small-gs-seed1",
                "small-gs-seed2",
                "small-dials-F100K-seed1",
                "small-dials-F100K-seed2",
                "small-dials-F1M-seed1",
                "small-dials-F1M-seed2",
            ]
        );
    }

    #[test]
    fn a_run_that_two_grids_share_is_made_once() {
        // 1000000 is what the config says when it says nothing.
        let text = "seeds = [1]\n[[grid]]\nconfigs = ['small.toml']\n\
                    [[grid]]\nconfigs = ['small.toml']\nretrain_every_steps = [1000000, 500000]";
        assert_eq!(names(text), ["small-dials-seed1", "small-dials-F500K-seed1"]);
    }

    #[test]
    fn settings_are_laid_over_configs_and_need_names_of_their_own() {
        let grid = "[[grid]]\nconfigs = ['small.toml']\n";
        let changed = format!("{grid}set = ['ppo.clip=0.2']\n");
        let experiment =
            read(&format!("seeds = [7]\nset = ['total_steps=1000']\n{grid}{changed}name = 'clip'")).unwrap();
        let [base, clip] = [0, 1].map(|run| &experiment.runs[run]);
        assert_eq!((base.config.total_steps, base.config.ppo.clip, base.config.seed), (1000, 0.1, 7));
        assert_eq!((clip.name.as_str(), clip.config.ppo.clip), ("small-dials-clip-seed7", 0.2));
        let error = format!("{:#}", read(&format!("seeds = [7]\n{grid}{changed}")).unwrap_err());
        assert!(error.contains("two runs would be called small-dials-seed7: give a [[grid]] a `name`"), "{error}");
    }

    #[test]
    fn bad_input_names_the_file_and_what_is_wrong() {
        for (text, told) in [
            ("seeds = [1]\ngrid = []", "has no [[grid]]"),
            ("[[grid]]\nconfigs = ['small.toml']", "missing field `seeds`"),
            ("seeds = [1]\n[[grid]]\nconfigs = []", "without configs"),
            ("seeds = [1]\n[[grid]]\nconfigs = ['no.toml']", "no.toml: cannot be read"),
            ("seeds = [1]\nseed = 2\n[[grid]]\nconfigs = ['small.toml']", "unknown field `seed`"),
            ("seeds = [1]\n[[grid]]\nconfigs = ['small.toml']\nset = ['ppo.klip=1']", "unknown field `klip`"),
            ("seeds = [1]\n[[grid]]\nconfigs = ['small.toml']\nsimulators = ['ials']", "unknown variant `ials`"),
        ] {
            let error = format!("{:#}", read(text).unwrap_err());
            assert!(error.contains("e.toml") && error.contains(told), "{error}");
        }
    }

    #[test]
    fn controllers_are_measured_once_per_scenario() {
        let grid = "[[grid]]\nconfigs = ['small.toml', 'large.toml']\n";
        let experiment = read(&format!("seeds = [1]\ncontrollers = ['random']\n{grid}{grid}")).unwrap();
        let names: Vec<&str> = experiment.baselines.iter().map(|baseline| baseline.name.as_str()).collect();
        assert_eq!(names, ["small-random", "large-random"]);
        assert_eq!(experiment.runs.len(), 2);
    }
}
