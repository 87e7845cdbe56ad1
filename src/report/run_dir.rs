//! One run, read from the directory that it left behind or is still filling.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Deserialize;
use serde_json::Value;

use super::before;
use super::csv_table::{CsvTable, Line};
use crate::config::{self, Config};
use crate::domain::Scenario;
use crate::training::files;
use crate::training::tables::ALL;

/// What a run directory tells.
#[derive(Clone, Debug)]
pub struct RunRecord {
    pub dir: PathBuf,
    pub config: Config,
    /// `run.json`: command line and versions.
    pub about: Value,
    /// What was simulated; `None` where nothing tells of how many agents.
    pub scenario: Option<Scenario>,
    /// In order of steps.
    pub evaluations: Vec<Evaluation>,
    /// Trainings of the AIPs, in order of steps.
    pub aip_trainings: Vec<AipTraining>,
    /// Cross-entropies of the AIPs on fresh GS data, in order of steps; empty where the run did not measure them.
    pub fresh_losses: Vec<FreshLoss>,
    /// In order of periods.
    pub periods: Vec<PeriodTime>,
    pub memory: Option<Memory>,
    /// Worker processes, or 1 for a run without any.
    pub workers: usize,
}

/// An evaluation of the joint policy on the GS.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// Timesteps per agent.
    pub steps: u64,
    pub all: Returns,
    /// Agent by agent.
    pub agents: Vec<Returns>,
    /// Number of episodes, if the file has it.
    pub episodes: Option<usize>,
    /// Mean returns of all agents, episode by episode; empty if the run did not write them down.
    pub episode_returns: Vec<f64>,
}

/// Figures of an evaluation, of one agent or all.
#[derive(Clone, Copy, Debug)]
pub struct Returns {
    pub mean: f64,
    /// For all: over the agents' means.
    pub median: f64,
    /// Over the episodes.
    pub std_error: f64,
    /// Agents that are stuck; 0 or 1 for one agent.
    pub stuck: usize,
}

/// Cross-entropy in nats, the mean of all agents and sources, on the held-out episodes of a dataset.
#[derive(Clone, Copy, Debug)]
pub struct AipTraining {
    pub steps: u64,
    pub before: f64,
    pub after: f64,
    /// Of the best constant.
    pub marginals: f64,
}

/// Cross-entropy in nats, the mean of all agents and sources, on GS episodes that no AIP was trained on.
#[derive(Clone, Copy, Debug)]
pub struct FreshLoss {
    pub steps: u64,
    /// Whether the AIPs have just been trained here, or are as they were.
    pub after_training: bool,
    pub loss: f64,
    /// Of the best constant.
    pub marginals: f64,
}

/// Wall and CPU seconds since the run began, at the end of a period.
#[derive(Clone, Copy, Debug, Default)]
pub struct PeriodTime {
    pub steps: u64,
    pub elapsed_s: f64,
    /// Of it: evaluations of policies and AIPs, which are no part of the training.
    pub evaluation_s: f64,
    /// Of it: collection of datasets and training of the AIPs.
    pub influence_s: f64,
    /// CPU time of all processes; `None` for runs that did not measure it.
    pub cpu: Option<CpuTime>,
}

impl PeriodTime {
    /// Wall time without the evaluations, as the paper counts it.
    pub fn runtime_s(self) -> f64 {
        self.elapsed_s - self.evaluation_s
    }
}

/// CPU seconds of all processes, user and system.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CpuTime {
    pub total_s: f64,
    /// Part of it for evaluations.
    pub evaluation_s: f64,
}

impl CpuTime {
    /// CPU time without the evaluations.
    pub fn runtime_s(self) -> f64 {
        self.total_s - self.evaluation_s
    }
}

/// Peak memory in MiB.
#[derive(Clone, Copy, Debug)]
pub struct Memory {
    /// The largest process, shared libraries counted in full.
    pub process_mb: f64,
    /// All processes, likewise.
    pub total_mb: f64,
    /// All processes, shared pages counted once.
    pub total_pss_mb: Option<f64>,
}

impl Memory {
    /// The larger of each figure.
    pub fn max(self, other: Memory) -> Memory {
        Memory {
            process_mb: self.process_mb.max(other.process_mb),
            total_mb: self.total_mb.max(other.total_mb),
            total_pss_mb: self.total_pss_mb.into_iter().chain(other.total_pss_mb).reduce(f64::max),
        }
    }
}

/// How far a run has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    Finished,
    /// Evaluated up to here.
    Unfinished {
        steps: u64,
    },
    /// Not evaluated yet, not even at its beginning.
    Empty,
}

/// A run directory is a folder with a config.
pub fn is_run_dir(path: &Path) -> bool {
    path.join(files::CONFIG).is_file()
}

impl RunRecord {
    pub fn read(dir: &Path) -> Result<RunRecord> {
        let config = config::load_kept(&dir.join(files::CONFIG))?;
        let about = read_about(&dir.join(files::RUN))?;
        let timing = CsvTable::read(&dir.join(files::TIMING))?;
        let evaluations = read_evaluations(
            &CsvTable::read(&dir.join(files::RETURNS))?,
            &CsvTable::read(&dir.join(files::EPISODES))?,
        )?;
        let agents = evaluations.first().map(|first| first.agents.len());
        Ok(RunRecord {
            scenario: scenario_in(&about, &config, agents)?,
            config,
            about,
            evaluations,
            aip_trainings: read_aip_trainings(&CsvTable::read(&dir.join(files::AIP_LOSS))?)?,
            fresh_losses: read_fresh_losses(&CsvTable::read(&dir.join(files::AIP_DRIFT))?)?,
            periods: read_periods(&timing)?,
            memory: read_memory(&CsvTable::read(&dir.join(files::MEMORY))?)?,
            workers: timing.lines().filter_map(|line| line.text("worker")?.parse::<usize>().ok()).max().unwrap_or(0)
                + 1,
            dir: dir.to_owned(),
        })
    }

    pub fn status(&self) -> Status {
        match self.evaluations.last() {
            None => Status::Empty,
            // Periods are whole updates of the policies, so the last one may end a little later than asked.
            Some(last) if last.steps >= self.config.last_step() => Status::Finished,
            Some(last) => Status::Unfinished { steps: last.steps },
        }
    }

    /// The mean return of all agents at a step, interpolated between two evaluations; none outside of them.
    pub fn return_at(&self, steps: u64) -> Option<f64> {
        self.interpolated(steps, |evaluation| evaluation.all.mean)
    }

    /// The median over agents, likewise.
    pub fn median_at(&self, steps: u64) -> Option<f64> {
        self.interpolated(steps, |evaluation| evaluation.all.median)
    }

    fn interpolated(&self, steps: u64, figure: impl Fn(&Evaluation) -> f64) -> Option<f64> {
        interpolate(self.evaluations.iter().map(|evaluation| (evaluation.steps, figure(evaluation))), steps)
    }

    /// Wall time without evaluations until a step, in seconds; none where the run has not come so far.
    pub fn runtime_at(&self, steps: u64) -> Option<f64> {
        Some(self.time_at(steps)?.runtime_s())
    }

    /// Wall time until a step: that of the last period that ends there, or in proportion between the ends of two periods;
    /// none where the run has not come so far.
    pub fn time_at(&self, steps: u64) -> Option<PeriodTime> {
        let until = self.periods.iter().rev().find(|period| period.steps <= steps);
        let next = self.periods.iter().find(|period| period.steps > steps);
        let beginning =
            || PeriodTime { cpu: next.and_then(|next| next.cpu).map(|_| CpuTime::default()), ..PeriodTime::default() };
        let until = until.copied().unwrap_or_else(beginning);
        if until.steps == steps {
            return Some(until);
        }
        let next = next?;
        let share = (steps - until.steps) as f64 / (next.steps - until.steps) as f64;
        let part = |from: f64, to: f64| from + share * (to - from);
        Some(PeriodTime {
            steps,
            elapsed_s: part(until.elapsed_s, next.elapsed_s),
            evaluation_s: part(until.evaluation_s, next.evaluation_s),
            influence_s: part(until.influence_s, next.influence_s),
            cpu: until.cpu.zip(next.cpu).map(|(until, next)| CpuTime {
                total_s: part(until.total_s, next.total_s),
                evaluation_s: part(until.evaluation_s, next.evaluation_s),
            }),
        })
    }

    /// The whole of it so far.
    pub fn total_time(&self) -> Option<PeriodTime> {
        self.periods.last().copied()
    }
}

/// Linear between the points left and right of `at`; none outside of them. Where two points share a place, the first
/// counts.
fn interpolate(points: impl Iterator<Item = (u64, f64)>, at: u64) -> Option<f64> {
    let mut before = None;
    for (place, value) in points {
        if place == at {
            return Some(value);
        }
        if place > at {
            let (left, left_value): (u64, f64) = before?;
            let share = (at - left) as f64 / (place - left) as f64;
            return Some(left_value + share * (value - left_value));
        }
        before = Some((place, value));
    }
    None
}

/// What the run in `dir` simulates; `config` is the run's, `agents` their number.
pub fn scenario_of(dir: &Path, config: &Config, agents: usize) -> Result<Scenario> {
    let about = read_about(&dir.join(files::RUN))?;
    Ok(scenario_in(&about, config, Some(agents))?.expect("the number of agents is known"))
}

/// As `run.json` says, or for older runs as far as the config tells.
fn scenario_in(about: &Value, config: &Config, agents: Option<usize>) -> Result<Option<Scenario>> {
    match about.get("scenario") {
        Some(scenario) => {
            let scenario = Scenario::deserialize(scenario).with_context(|| format!("{}: scenario", files::RUN))?;
            Ok(Some(scenario))
        }
        None => before::scenario(config, agents),
    }
}

fn read_about(path: &Path) -> Result<Value> {
    if !path.exists() {
        return Ok(Value::Null);
    }
    let text = std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{}: is no JSON", path.display()))
}

/// `table`: `returns.csv`; `episodes`: `episodes.csv`.
fn read_evaluations(table: &CsvTable, episodes: &CsvTable) -> Result<Vec<Evaluation>> {
    let mut of_episodes = read_episodes(episodes)?;
    let mut evaluations: Vec<Evaluation> = Vec::new();
    for line in table.lines() {
        let returns = Returns {
            mean: line.required("mean")?,
            median: line.required("median")?,
            std_error: line.required("std_error")?,
            stuck: line.number("stuck")?.unwrap_or(0.0) as usize,
        };
        match (line.text("agent"), evaluations.last_mut()) {
            (Some(ALL), _) => {
                let steps = line.steps()?;
                let episodes = line.number("episodes")?.map(|count| count as usize);
                let episode_returns = of_episodes.remove(&steps).unwrap_or_default();
                evaluations.push(Evaluation { steps, all: returns, agents: Vec::new(), episodes, episode_returns });
            }
            (_, Some(evaluation)) => evaluation.agents.push(returns),
            (_, None) => anyhow::bail!("{}: begins with an agent and not with `{ALL}`", files::RETURNS),
        }
    }
    let agents = evaluations.iter().map(|evaluation| evaluation.agents.len()).max().unwrap_or(0).max(1);
    // Cut short by a kill.
    evaluations.pop_if(|last| last.agents.len() < agents);
    if let Some(bad) = evaluations.iter().find(|evaluation| evaluation.agents.len() != agents) {
        let (steps, found) = (bad.steps, bad.agents.len());
        anyhow::bail!("{}: tells of {found} of {agents} agents at step {steps}", files::RETURNS);
    }
    // Likewise: its episodes are written after it.
    if let Some(last) =
        evaluations.last_mut().filter(|last| last.episodes.is_some_and(|all| last.episode_returns.len() < all))
    {
        last.episode_returns.clear();
    }
    let uneven = |evaluation: &&Evaluation| {
        let found = evaluation.episode_returns.len();
        found > 0 && evaluation.episodes.is_some_and(|episodes| episodes != found)
    };
    if let Some(bad) = evaluations.iter().find(uneven) {
        let (steps, found, all) = (bad.steps, bad.episode_returns.len(), bad.episodes.unwrap_or(0));
        anyhow::bail!("{}: has {found} of {all} episodes at step {steps}", files::EPISODES);
    }
    Ok(evaluations)
}

/// Mean returns of all agents by steps, episode by episode.
fn read_episodes(table: &CsvTable) -> Result<BTreeMap<u64, Vec<f64>>> {
    let mut of_steps: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    for line in table.lines() {
        let (steps, episode) = (line.steps()?, line.required("episode")? as usize);
        let returns = of_steps.entry(steps).or_default();
        anyhow::ensure!(
            episode == returns.len(),
            "{}: has episode {episode} at step {steps} where episode {} belongs",
            files::EPISODES,
            returns.len()
        );
        returns.push(line.required("return")?);
    }
    Ok(of_steps)
}

fn of_all_sources(line: Line) -> bool {
    line.text("agent") == Some(ALL) && line.text("source").is_none_or(|source| source == ALL)
}

fn read_aip_trainings(table: &CsvTable) -> Result<Vec<AipTraining>> {
    let trainings = table.lines().filter(|&line| of_all_sources(line)).map(|line| {
        Ok(AipTraining {
            steps: line.steps()?,
            before: line.required("held_out_before")?,
            after: line.required("held_out_after")?,
            marginals: line.required("held_out_marginals")?,
        })
    });
    trainings.collect()
}

fn read_fresh_losses(table: &CsvTable) -> Result<Vec<FreshLoss>> {
    let losses = table.lines().filter(|&line| of_all_sources(line)).map(|line| {
        Ok(FreshLoss {
            steps: line.steps()?,
            after_training: line.text("after") == Some("training"),
            loss: line.required("loss")?,
            marginals: line.required("marginals")?,
        })
    });
    losses.collect()
}

/// The phases of `timing.csv` that are no training of policies. A file that lacks one of them spent no time there.
const EVALUATION: [&str; 1] = ["evaluation_s"];
const INFLUENCE: [&str; 2] = ["collection_s", "aip_training_s"];

/// Sums of seconds since the run began.
fn read_periods(table: &CsvTable) -> Result<Vec<PeriodTime>> {
    let spent = |line: Line, columns: &[&str]| -> Result<f64> {
        columns.iter().map(|column| Ok(line.number(column)?.unwrap_or(0.0))).sum()
    };
    let (mut evaluation_s, mut influence_s) = (0.0, 0.0);
    // A run of an older version has no such columns, and one that was begun by it has no sum.
    let mut cpu = Some(CpuTime::default());
    let mut periods = Vec::new();
    for line in table.lines().filter(|line| line.text("worker") == Some(ALL)) {
        evaluation_s += spent(line, &EVALUATION)?;
        influence_s += spent(line, &INFLUENCE)?;
        let (steps, elapsed_s) = (line.steps()?, line.required("elapsed_s")?);
        cpu = match (cpu, line.number("cpu_s")?) {
            (Some(before), Some(more)) => Some(CpuTime {
                total_s: before.total_s + more,
                evaluation_s: before.evaluation_s + line.required("cpu_evaluation_s")?,
            }),
            _ => None,
        };
        periods.push(PeriodTime { steps, elapsed_s, evaluation_s, influence_s, cpu });
    }
    Ok(periods)
}

fn read_memory(table: &CsvTable) -> Result<Option<Memory>> {
    let mut memory: Option<Memory> = None;
    for line in table.lines() {
        let (rss, pss) = (line.required("peak_rss_mb")?, line.number("pss_mb")?);
        let here = match line.text("process") {
            Some(ALL) => Memory { process_mb: 0.0, total_mb: rss, total_pss_mb: pss },
            _ => Memory { process_mb: rss, total_mb: 0.0, total_pss_mb: None },
        };
        memory = Some(memory.map_or(here, |so_far| so_far.max(here)));
    }
    Ok(memory)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_evaluations_a_curve_is_a_straight_line_and_beyond_them_there_is_none() {
        let at = |steps| interpolate([(100, 10.0), (300, 20.0), (300, 90.0)].into_iter(), steps);
        // A quarter of the way from 100 to 300 the value is 10 + 10 / 4.
        assert_eq!((at(100), at(150), at(300)), (Some(10.0), Some(12.5), Some(20.0)));
        assert_eq!((at(99), at(301)), (None, None));
    }
    fn evaluations(text: &str) -> Result<Vec<(u64, usize)>> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(files::RETURNS);
        std::fs::write(&path, format!("steps,agent,mean,median,std_error\n{text}")).unwrap();
        let read = read_evaluations(&CsvTable::read(&path)?, &CsvTable::read(&dir.path().join(files::EPISODES))?)?;
        Ok(read.iter().map(|evaluation| (evaluation.steps, evaluation.agents.len())).collect())
    }

    #[test]
    fn an_evaluation_that_was_cut_short_is_none_and_a_hole_in_the_middle_is_told() {
        let block = |steps: u64, agents: usize| {
            let names = std::iter::once("all".to_owned()).chain((0..agents).map(|agent| agent.to_string()));
            names.map(|name| format!("{steps},{name},1,1,0\n")).collect::<String>()
        };
        assert_eq!(evaluations(&(block(0, 2) + &block(100, 1))).unwrap(), [(0, 2)]);
        assert_eq!(evaluations(&block(0, 0)).unwrap(), [], "no agent is no evaluation");
        let error = evaluations(&(block(0, 2) + &block(100, 1) + &block(200, 2))).unwrap_err().to_string();
        assert_eq!(error, "returns.csv: tells of 1 of 2 agents at step 100");
    }

    #[test]
    fn episodes_belong_to_the_evaluation_of_their_step() {
        let dir = tempfile::tempdir().unwrap();
        let read = |episodes: &str| -> Result<Vec<Evaluation>> {
            let [returns, file] = [files::RETURNS, files::EPISODES].map(|name| dir.path().join(name));
            let blocks = "0,all,1,1,0,1\n0,0,1,1,0,1\n100,all,2,2,0,2\n100,0,2,2,0,2\n";
            std::fs::write(&returns, format!("steps,agent,mean,median,std_error,episodes\n{blocks}")).unwrap();
            std::fs::write(&file, format!("steps,episode,return\n{episodes}")).unwrap();
            read_evaluations(&CsvTable::read(&returns)?, &CsvTable::read(&file)?)
        };
        let found = read("0,0,1.000000\n100,0,1.500000\n100,1,2.500000\n").unwrap();
        assert_eq!(found[0].episode_returns, [1.0]);
        assert_eq!((found[1].episodes, &found[1].episode_returns[..]), (Some(2), &[1.5, 2.5][..]));
        assert!(read("").unwrap()[1].episode_returns.is_empty(), "an older version wrote none");
        let error = |episodes| read(episodes).unwrap_err().to_string();
        assert!(read("0,0,1\n100,0,1.5\n").unwrap()[1].episode_returns.is_empty(), "they are being written");
        assert_eq!(error("0,0,1\n0,1,1\n"), "episodes.csv: has 2 of 1 episodes at step 0");
        assert_eq!(error("100,1,1.5\n"), "episodes.csv: has episode 1 at step 100 where episode 0 belongs");
    }
}
