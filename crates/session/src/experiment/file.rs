//! The file of an experiment, and the runs that it plans.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use serde::Deserialize;

use crate::config::RunConfig;
use crate::records::find::MeasuredWith;
use crate::records::method::{Method, Retraining, steps_text};
use dials_core::domain::{RoughCosts, Scenario};
use dials_core::outside::{FileName, in_plain_words, quoted, read_text};
use dials_learn::config::ShortForm;

/// Largest file. That of the largest experiment here has two kibibytes.
const LARGEST_FILE: u64 = 1 << 20;
/// Number of agents from which on a run takes all cores, if the file does not say it.
const ALL_CORES_FROM_AGENTS: usize = 25;
/// Largest number of combinations that a file may list.
const MOST_RUNS: usize = 10_000;
/// Number of episodes that a controller may play, as for `baseline --episodes`.
const EPISODES: RangeInclusive<u32> = 1..=100_000;

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExperimentFile {
    /// Seeds of all runs, unless a grid has its own. Every combination runs once per seed.
    seeds: Vec<u64>,
    /// Settings of all runs, in the form of `train --set`.
    set: Vec<String>,
    /// Hand-coded controllers to measure on every scenario, for the report's dashed lines.
    controllers: Vec<String>,
    /// Number of episodes that each of them plays. Default: those of a run's last evaluation, to compare one by one.
    controller_episodes: Option<u32>,
    /// Number of agents from which on a run takes all cores. Smaller ones run side by side, one core each.
    all_cores_from_agents: Option<usize>,
    grid: Vec<RunGrid>,
}

/// All combinations of the listed configs, simulators, values of F and seeds.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RunGrid {
    /// Config files, relative to the file of the experiment.
    configs: Vec<PathBuf>,
    /// Simulators. Default: the one in each config.
    simulators: Vec<ShortForm>,
    /// Values of F. Only for simulators with trained AIPs. Default: the one in each config.
    retrain_every_steps: Vec<u64>,
    /// Seeds of these runs. Default: those of the experiment.
    seeds: Option<Vec<u64>>,
    /// Settings of these runs, in addition to those of the experiment.
    set: Vec<String>,
    /// Word to add to the names of these runs.
    name: Option<FileName>,
}

#[derive(Clone, Debug)]
pub struct PlannedRun {
    /// Name of its directory.
    pub name: FileName,
    pub config_path: PathBuf,
    pub settings: Vec<String>,
    pub config: RunConfig,
    pub scenario: Scenario,
    pub rough_costs: RoughCosts,
}

impl PlannedRun {
    pub fn agents(&self) -> usize {
        self.scenario.id.agents
    }
}

/// A hand-coded controller that an experiment plans to measure.
#[derive(Clone, Debug)]
pub struct PlannedBaseline {
    /// Name of its file, without extension.
    pub name: FileName,
    /// Config of the first run on its scenario, with its settings.
    pub config: RunConfig,
    /// Id of the scenario: [`dials_core::domain::ScenarioId::word`].
    pub(crate) scenario: String,
    pub controller: String,
    pub episodes: usize,
    pub(crate) agents: usize,
    pub(crate) rough_costs: RoughCosts,
    pub(crate) measured_with: MeasuredWith,
}

#[derive(Debug)]
pub struct Experiment {
    pub baselines: Vec<PlannedBaseline>,
    pub runs: Vec<PlannedRun>,
    pub all_cores_from_agents: usize,
}

/// Facts that only the domain of a config knows.
pub struct Knowledge<'a> {
    pub simulated: &'a dyn Fn(&RunConfig) -> Result<(Scenario, RoughCosts)>,
    /// Returns what a controller would be measured with now; an error if it, or its file, is unknown.
    pub controller: &'a dyn Fn(&RunConfig, &str) -> Result<MeasuredWith>,
}

impl Experiment {
    /// Reads a file and checks all of it. A run that is listed twice is planned once. So is a controller on a scenario.
    pub fn read(path: &Path, knowledge: &Knowledge) -> Result<Experiment> {
        let shown = path.display();
        let text = read_text(path, LARGEST_FILE).with_context(|| format!("{shown}: cannot be read"))?;
        let is_config = toml::from_str::<RunConfig>(&text).is_ok_and(|config| config.domain.is_some());
        ensure!(!is_config, "{shown}: is a config, not an experiment file; use: dials-traffic train {}", quoted(path));
        let file: ExperimentFile = toml::from_str(&text)
            .map_err(|error: toml::de::Error| anyhow!("{shown}: {}", in_plain_words(&error.to_string())))?;
        if let Some(episodes) = file.controller_episodes.filter(|episodes| !EPISODES.contains(episodes)) {
            let (least, most) = (EPISODES.start(), EPISODES.end());
            bail!("{shown}: controller_episodes = {episodes}: must be from {least} to {most}");
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut experiment = Experiment {
            baselines: Vec::new(),
            runs: Vec::new(),
            all_cores_from_agents: file.all_cores_from_agents.unwrap_or(ALL_CORES_FROM_AGENTS),
        };
        ensure!(!file.grid.is_empty(), "{shown}: has no [[grid]], and so no runs");
        let listed = file.grid.iter().map(|grid| grid.count(&file)).fold(0, usize::saturating_add);
        ensure!(
            listed <= MOST_RUNS,
            "{shown}: lists {listed} runs, but at most {MOST_RUNS} are allowed; split it into several experiments"
        );
        let mut names: BTreeMap<String, PathBuf> = BTreeMap::new();
        for grid in &file.grid {
            ensure!(!grid.configs.is_empty(), "{shown}: a [[grid]] without configs has no runs");
            let seeds = grid.seeds.as_ref().unwrap_or(&file.seeds);
            ensure!(
                !seeds.is_empty(),
                "{shown}: a [[grid]] without seeds has no runs; add `seeds = [1]` to it, or before the first [[grid]] for all"
            );
            ensure!(
                grid.retrain_every_steps.is_empty()
                    || grid.simulators.is_empty()
                    || grid.simulators.iter().any(|kind| kind.trains_predictors()),
                "{shown}: retrain_every_steps: no simulator of its [[grid]] trains AIPs; leave it out"
            );
            for config in &grid.configs {
                let config_path = folder.join(config);
                let name = name_of(&config_path, &mut names).with_context(|| shown.to_string())?;
                for run in grid.combinations(seeds) {
                    let added = experiment.add_run(&file, grid, &config_path, &name, run, knowledge);
                    added.with_context(|| format!("{shown}: planned run"))?;
                }
            }
        }
        experiment.add_baselines(&file, knowledge).with_context(|| format!("{shown}: controllers"))?;
        Ok(experiment)
    }

    fn add_baselines(&mut self, file: &ExperimentFile, knowledge: &Knowledge) -> Result<()> {
        for run in &self.runs {
            let scenario = run.scenario.id.word();
            for controller in &file.controllers {
                let same = |other: &PlannedBaseline| other.scenario == scenario && other.controller == *controller;
                if self.baselines.iter().any(same) {
                    continue;
                }
                let measured_with = (knowledge.controller)(&run.config, controller)?;
                // The name of a controller can contain the path of a file of timings.
                let (stem, word) = (stem(&run.config_path), controller.replace('/', "_"));
                let mut name = format!("{stem}-{word}");
                if self.baselines.iter().any(|other| *other.name == *name) {
                    name = format!("{stem}-{scenario}-{word}");
                }
                self.baselines.push(PlannedBaseline {
                    name: FileName::new(name)?,
                    config: run.config.clone(),
                    scenario: scenario.clone(),
                    controller: controller.clone(),
                    episodes: file
                        .controller_episodes
                        .map_or(run.config.learning.evaluation.final_episodes, |count| count as usize),
                    agents: run.agents(),
                    rough_costs: run.rough_costs,
                    measured_with,
                });
            }
        }
        Ok(())
    }

    fn add_run(
        &mut self,
        file: &ExperimentFile,
        grid: &RunGrid,
        config_path: &Path,
        config_name: &str,
        (simulator, every, seed): Combination,
        knowledge: &Knowledge,
    ) -> Result<()> {
        let mut settings: Vec<String> = file.set.iter().chain(&grid.set).cloned().collect();
        settings.extend(simulator.map(|kind| format!("simulator={}", kind.name)));
        settings.extend(every.map(|every| format!("aip.retrain_every_steps={every}")));
        settings.push(format!("seed={seed}"));
        let config = crate::config::load(config_path, &settings)?;
        let (scenario, rough_costs) = (knowledge.simulated)(&config)?;
        let retraining = Method::of(&config, &scenario).retraining;
        ensure!(
            every.is_none() || matches!(retraining, Retraining::Every(_)),
            "retrain_every_steps: has no effect with simulator = {} and aip.retrain = {}: leave it out, or give these runs a \
             [[grid]] of their own",
            config.learning.short_form().name,
            toml::Value::try_from(config.learning.aip.retrain)?.as_str().unwrap_or_default()
        );
        let mut name = format!("{config_name}-{}", config.learning.short_form().name);
        name.extend(every.map(|every| format!("-F{}", grid.text_of(every))));
        name.extend(grid.name.iter().map(|name| format!("-{name}")));
        let name = FileName::new(format!("{name}-seed{seed}"))?;
        // Two combinations give the same run if F is the config's own, or if grids overlap.
        if self.runs.iter().any(|run| run.config_path == config_path && run.config == config) {
            return Ok(());
        }
        ensure!(
            self.runs.iter().all(|run| run.name != name),
            "two runs would be called {name}: give a [[grid]] a `name` of its own"
        );
        let config_path = config_path.to_owned();
        self.runs.push(PlannedRun { name, config_path, settings, config, scenario, rough_costs });
        Ok(())
    }
}

impl RunGrid {
    /// Returns the number of its runs, counted as if every simulator had every F.
    fn count(&self, file: &ExperimentFile) -> usize {
        let seeds = self.seeds.as_ref().unwrap_or(&file.seeds).len();
        let factors = [self.configs.len(), self.simulators.len().max(1), self.retrain_every_steps.len().max(1), seeds];
        factors.into_iter().fold(1, usize::saturating_mul)
    }

    fn combinations(&self, seeds: &[u64]) -> Vec<Combination> {
        fn one_of<T: Copy>(listed: &[T]) -> Vec<Option<T>> {
            if listed.is_empty() { vec![None] } else { listed.iter().copied().map(Some).collect() }
        }
        let mut combinations = Vec::new();
        for simulator in one_of(&self.simulators) {
            let trained = simulator.is_none_or(|kind| kind.trains_predictors());
            for every in one_of(if trained { &self.retrain_every_steps[..] } else { &[] }) {
                combinations.extend(seeds.iter().map(|&seed| (simulator, every, seed)));
            }
        }
        combinations
    }

    /// Writes an F of this grid: rounded, unless another one rounds to the same.
    fn text_of(&self, every: u64) -> String {
        let short = steps_text(every);
        let is_same = |other: &u64| *other != every && steps_text(*other) == short;
        if self.retrain_every_steps.iter().any(is_same) { every.to_string() } else { short }
    }
}

/// Simulator, F and seed of a run. `None`: the config decides.
type Combination = (Option<ShortForm>, Option<u64>, u64);

/// Names a config in the names of runs: by its file, or by `FOLDER-FILE` if that is in `names`, given so far.
fn name_of(config: &Path, names: &mut BTreeMap<String, PathBuf>) -> Result<String> {
    let stem = stem(config);
    let folder = config.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    for name in [stem.clone(), format!("{folder}-{stem}")] {
        if *names.entry(name.clone()).or_insert_with(|| config.to_owned()) == config {
            return Ok(name);
        }
    }
    let other = names[&stem].display();
    bail!("{other} and {} have the same file and folder name, but runs are named after them", config.display())
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Returns a planned run called `a run`.
    pub(crate) fn planned(config: RunConfig, scenario: Scenario) -> PlannedRun {
        PlannedRun {
            name: FileName::new("a run").unwrap(),
            config_path: PathBuf::new(),
            settings: Vec::new(),
            config,
            scenario,
            rough_costs: RoughCosts { evaluation_s: 1e-3, process_mb: 120.0, agent_mb: 8.0, ..RoughCosts::default() },
        }
    }

    /// Returns a controller that is planned on the scenario of a run.
    pub(crate) fn planned_baseline(run: &PlannedRun, episodes: usize) -> PlannedBaseline {
        PlannedBaseline {
            name: FileName::new("small-random").unwrap(),
            config: run.config.clone(),
            scenario: run.scenario.id.word(),
            controller: "random".to_owned(),
            episodes,
            agents: run.agents(),
            rough_costs: run.rough_costs,
            measured_with: MeasuredWith::default(),
        }
    }

    const CONFIG: &str = "[warehouse]\nagents_per_side = 2\n";

    /// A domain that knows only the controllers `random` and `fixed-time...`.
    const KNOWLEDGE: Knowledge = Knowledge {
        simulated: &|config| Ok((Scenario::new("warehouse", 4, config.horizon()), RoughCosts::default())),
        controller: &|_, name| {
            ensure!(name == "random" || name.starts_with("fixed-time"), "controller `{name}`: unknown");
            Ok(MeasuredWith::default())
        },
    };

    fn read(text: &str) -> Result<Experiment> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(dir.path().join("other/paper")).unwrap();
        std::fs::create_dir(dir.path().join("paper")).unwrap();
        for name in ["small", "large", "paper/small", "other/paper/small"] {
            let config = CONFIG.replace('2', if name.starts_with("paper") { "3" } else { "2" });
            std::fs::write(dir.path().join(format!("{name}.toml")), config).unwrap();
        }
        std::fs::write(dir.path().join("e.toml"), text).unwrap();
        Experiment::read(&dir.path().join("e.toml"), &KNOWLEDGE)
    }

    fn names(text: &str) -> Vec<String> {
        read(text).unwrap().runs.into_iter().map(|run| run.name.to_string()).collect()
    }

    #[test]
    fn a_grid_is_all_combinations_of_what_it_lists_and_a_run_that_two_grids_share_is_made_once() {
        let text = "seeds = [1, 2]\n[[grid]]\nconfigs = ['small.toml']\nsimulators = ['gs', 'dials']\n\
                    retrain_every_steps = [100000, 2000000]";
        let of_kinds =
            ["gs", "dials-F100K", "dials-F2M"].map(|kind| [1, 2].map(|seed| format!("small-{kind}-seed{seed}")));
        assert_eq!(names(text), of_kinds.concat());
        // 1000000 is the default of the config.
        let text = "seeds = [1]\n[[grid]]\nconfigs = ['small.toml']\n\
                    [[grid]]\nconfigs = ['small.toml']\nretrain_every_steps = [1000000, 500000]";
        assert_eq!(names(text), ["small-dials-seed1", "small-dials-F500K-seed1"]);
    }

    #[test]
    fn settings_are_laid_over_configs_and_need_names_of_their_own() {
        let grid = "[[grid]]\nconfigs = ['small.toml']\n";
        let text =
            format!("seeds = [7]\nset = ['total_steps=1000']\n{grid}{grid}set = ['ppo.clip=0.2']\nname = 'clip'");
        let experiment = read(&text).unwrap();
        let [base, clip] = [0, 1].map(|run| &experiment.runs[run].config.learning);
        assert_eq!((base.total_steps, base.ppo.clip, base.seed), (1000, 0.1, 7));
        assert_eq!((&*experiment.runs[1].name, clip.ppo.clip), ("small-dials-clip-seed7", 0.2));
        // Neither key makes a method of its own, but what is planned differs.
        for setting in ["evaluation.aip_loss_episodes=7", "logging.tensorboard=true"] {
            let text = |name: &str| format!("seeds = [1]\n{grid}{grid}set = ['{setting}']\n{name}");
            assert_eq!(names(&text("name = 'b'")), ["small-dials-seed1", "small-dials-b-seed1"]);
            let error = format!("{:#}", read(&text("")).unwrap_err());
            assert!(error.contains("two runs would be called small-dials-seed1: give a [[grid]] a `name`"), "{error}");
        }
    }

    #[test]
    fn configs_of_one_file_name_are_named_with_their_folders() {
        let text = "seeds = [1]\n[[grid]]\nconfigs = ['small.toml', 'paper/small.toml']\n\
                    [[grid]]\nconfigs = ['paper/small.toml']\nsimulators = ['gs']";
        assert_eq!(names(text), ["small-dials-seed1", "paper-small-dials-seed1", "paper-small-gs-seed1"]);
        let error = format!("{:#}", read(&text.replace("['paper", "['other/paper/small.toml', 'paper")).unwrap_err());
        assert!(error.contains("have the same file and folder name"), "{error}");
    }

    #[test]
    fn bad_input_names_the_file_and_what_is_wrong() {
        let assert_message = |text: &str, message: &str| {
            let error = format!("{:#}", read(text).unwrap_err());
            assert!(error.contains("e.toml") && error.contains(message), "{error}");
        };
        assert_message(CONFIG, "e.toml: is a config, not an experiment file; use: dials-traffic train");
        assert_message("seeds = [1]\ngrid = []", "has no [[grid]]");
        assert_message("seeds = [1]\n[[grid]]\nconfigs = []", "without configs");
        assert_message("seeds = [1]\n[[grid]]\nconfigs = ['no.toml']", "no.toml: cannot be read");
        let many: Vec<String> = (0..2000).map(|number| number.to_string()).collect();
        let many = format!("[{}]", many.join(","));
        let every = "retrain_every_steps = [100000, 500000]";
        let long = format!("name = '{}'", "x".repeat(190));
        let long_controller = format!("seeds = [1]\ncontrollers = ['fixed-time:file={}']", "x".repeat(190));
        // What stands before a grid, what stands in it, and the message.
        for (before, within, message) in [
            ("", "", "a [[grid]] without seeds has no runs; add `seeds = [1]`"),
            ("seeds = []", "", "without seeds"),
            ("seeds = [1]", "seeds = []", "without seeds"),
            ("seeds = [1]\ncontroller_episodes = 0", "", "controller_episodes = 0: must be from 1 to 100000"),
            ("seeds = [1]\ncontroller_episodes = 100001", "", "= 100001: must be from 1 to 100000"),
            ("seeds = [1]", &long, "bytes, and at most 200 are allowed"),
            (&long_controller, "", "controllers: "),
            (
                "seeds = [1]",
                &format!("set = ['aip.retrain=once']\n{every}"),
                "simulator = dials and aip.retrain = once",
            ),
            ("seeds = [1]", &format!("set = ['simulator=gs']\n{every}"), "has no effect with simulator = gs"),
            (
                &format!("seeds = {many}"),
                &format!("retrain_every_steps = {many}"),
                "lists 4000000 runs, but at most 10000",
            ),
        ] {
            assert_message(&format!("{before}\n[[grid]]\nconfigs = ['small.toml']\n{within}"), message);
        }
    }

    #[test]
    fn controllers_are_measured_once_per_scenario_with_the_settings_of_its_runs() {
        let grid = "[[grid]]\nconfigs = ['small.toml']\n";
        let shorter = format!("{grid}set = ['warehouse.horizon=50']\nname = 'shorter'\n");
        let experiment = read(&format!(
            "seeds = [1, 2]\ncontrollers = ['random', 'fixed-time:file=a/b.toml']\n{grid}{grid}{shorter}"
        ))
        .unwrap();
        let found: Vec<(&str, usize)> =
            experiment.baselines.iter().map(|baseline| (&*baseline.name, baseline.config.horizon())).collect();
        let names = [("small-random", 100), ("small-fixed-time:file=a_b.toml", 100)];
        let shorter = [("small-warehouse-4-50-random", 50), ("small-warehouse-4-50-fixed-time:file=a_b.toml", 50)];
        assert_eq!(found, [names, shorter].concat());
        assert_eq!(experiment.runs.len(), 4);
    }
}
