//! The run directory: what a run leaves behind, written as it goes.
//!
//! CSV files grow by whole blocks of lines, one write per block; everything else is written beside its place and moved
//! there. So a kill loses at most the current period, and what is there can be read at any time.
//!
//! | file | what |
//! |---|---|
//! | `config.toml`, `networks/` | the checked config and the SUMO networks it names: the run can be evaluated anywhere |
//! | `run.json` | seed, versions, command line |
//! | `returns.csv` | evaluations on the GS, per agent and for all |
//! | `training.csv` | each period of training, per agent: returns on the simulator it trained on, losses |
//! | `aip_loss.csv` | each training of the AIPs, per agent and source |
//! | `timing.csv` | seconds per phase |
//! | `policies.safetensors`, `aips.safetensors` | the networks, `[agents, ...]` |

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Instant;

use anyhow::{Context, Result};

use super::fleet::{AipTraining, PolicyTraining};
use crate::base::{Phase, Stopwatch};
use crate::evaluation::Evaluation;
use crate::nn::{Parameters, write_stack};
use crate::policy::JointPolicy;

/// The names of the files of a run directory.
pub mod files {
    pub const CONFIG: &str = "config.toml";
    pub const NETWORKS: &str = "networks";
    pub const RUN: &str = "run.json";
    pub const RETURNS: &str = "returns.csv";
    pub const TRAINING: &str = "training.csv";
    pub const AIP_LOSS: &str = "aip_loss.csv";
    pub const TIMING: &str = "timing.csv";
    pub const POLICIES: &str = "policies.safetensors";
    pub const AIPS: &str = "aips.safetensors";
}

/// Hears what a run has found, beside the files.
pub trait Listener {
    fn evaluated(&self, steps: u64, evaluation: &Evaluation);
    fn aips_trained(&self, steps: u64, training: &AipTraining);
}

/// Writes a run down.
pub struct RunLog {
    dir: PathBuf,
    listener: Rc<dyn Listener>,
    /// Where policies and AIPs keep their blocks within a row.
    layouts: Layouts,
    watch: Stopwatch,
    begun: Instant,
    begun_period: Instant,
}

/// The shapes of the stacks that are saved.
pub struct Layouts {
    pub policies: Parameters,
    pub aips: Parameters,
}

impl RunLog {
    /// Writes into `dir`, which exists.
    pub fn new(dir: &Path, layouts: Layouts, listener: Rc<dyn Listener>) -> Self {
        let now = Instant::now();
        RunLog { dir: dir.to_owned(), listener, layouts, watch: Stopwatch::default(), begun: now, begun_period: now }
    }

    /// Runs a phase of work and counts its wall time.
    pub fn time<T>(&mut self, phase: Phase, work: impl FnOnce() -> T) -> T {
        self.watch.time(phase, work)
    }

    /// An evaluation of the joint policy.
    pub fn evaluated(&mut self, steps: u64, evaluation: &Evaluation) -> Result<()> {
        let path = self.dir.join(files::RETURNS);
        append(&path, &evaluation_header(evaluation), &evaluation_lines(steps, evaluation))?;
        self.listener.evaluated(steps, evaluation);
        Ok(())
    }

    /// A training of the AIPs.
    pub fn aips_trained(&mut self, steps: u64, training: &AipTraining) -> Result<()> {
        self.watch.add(&training.watch);
        let header: Vec<String> = AIP_COLUMNS.iter().map(|&name| name.to_owned()).collect();
        append(&self.dir.join(files::AIP_LOSS), &header, &aip_lines(steps, training))?;
        let stack = write_stack(&self.layouts.aips, &training.parameters, &about(steps))?;
        write_atomically(&self.dir.join(files::AIPS), &stack)?;
        self.listener.aips_trained(steps, training);
        Ok(())
    }

    /// A period of training.
    pub fn policies_trained(&mut self, training: &PolicyTraining) -> Result<()> {
        self.watch.add(&training.watch);
        let header = training_header(training);
        append(&self.dir.join(files::TRAINING), &header, &training_lines(training))?;
        self.save_policies(training.steps, &training.policies)?;
        let header: Vec<String> = ["steps".into(), "wall_s".into(), "elapsed_s".into()]
            .into_iter()
            .chain(Phase::ALL.map(|phase| format!("{}_s", phase.name())))
            .collect();
        let now = Instant::now();
        let (wall, elapsed) = (now - self.begun_period, now - self.begun);
        let watch = self.watch.take();
        let seconds = [wall, elapsed].into_iter().chain(Phase::ALL.map(|phase| watch.spent(phase)));
        let seconds = seconds.map(|spent| format!("{:.3}", spent.as_secs_f64()));
        let line = std::iter::once(training.steps.to_string()).chain(seconds).collect();
        append(&self.dir.join(files::TIMING), &header, &[line])?;
        self.begun_period = now;
        Ok(())
    }

    fn save_policies(&self, steps: u64, policies: &JointPolicy) -> Result<()> {
        let stack = write_stack(&self.layouts.policies, policies, &about(steps))?;
        write_atomically(&self.dir.join(files::POLICIES), &stack)
    }
}

type Line = Vec<String>;

const ALL_AGENTS: &str = "all";

fn about(steps: u64) -> HashMap<String, String> {
    HashMap::from([("steps".to_owned(), steps.to_string())])
}

fn evaluation_header(evaluation: &Evaluation) -> Line {
    let fixed = ["steps", "agent", "mean", "median", "std_error", "episodes", "stuck"];
    let per_agent = evaluation.measures.per_agent.iter().map(|(name, _)| *name);
    let system = evaluation.measures.system.iter().map(|(name, _)| *name);
    fixed.into_iter().chain(per_agent).chain(system).map(str::to_owned).collect()
}

/// A line for all agents (`stuck`: how many), then one per agent (`stuck`: 0 or 1; no figures of the whole system).
fn evaluation_lines(steps: u64, evaluation: &Evaluation) -> Vec<Line> {
    let line = |agent: String, summary: crate::evaluation::Summary, stuck: usize| {
        let mut line = vec![steps.to_string(), agent];
        line.extend([summary.mean, summary.median, summary.std_error].map(|value| format!("{value:.4}")));
        line.extend([evaluation.episodes().to_string(), stuck.to_string()]);
        line
    };
    let measures = &evaluation.measures;
    let mut all =
        line(ALL_AGENTS.to_owned(), evaluation.of_all(), evaluation.stuck.iter().filter(|&&stuck| stuck).count());
    let means = measures.per_agent.iter().map(|(_, values)| values.iter().sum::<f64>() / values.len() as f64);
    all.extend(means.chain(measures.system.iter().map(|&(_, value)| value)).map(|value| format!("{value:.4}")));
    let mut lines = vec![all];
    for agent in 0..evaluation.agents() {
        let mut of_agent = line(agent.to_string(), evaluation.of_agent(agent), usize::from(evaluation.stuck[agent]));
        of_agent.extend(measures.per_agent.iter().map(|(_, values)| format!("{:.4}", values[agent])));
        of_agent.extend(measures.system.iter().map(|_| String::new()));
        lines.push(of_agent);
    }
    lines
}

const AIP_COLUMNS: [&str; 9] = [
    "steps",
    "agent",
    "source",
    "training_before",
    "training_after",
    "held_out_before",
    "held_out_after",
    "held_out_marginals",
    "frequency",
];

/// A line for the mean of all agents and sources, then per agent one for the mean of its sources and one per source.
fn aip_lines(steps: u64, training: &AipTraining) -> Vec<Line> {
    let mut of_agents: Vec<[f64; 6]> = Vec::new();
    let mut lines = Vec::new();
    let line = |agent: &str, source: &str, values: &[f64; 6]| -> Line {
        let keys = [steps.to_string(), agent.to_owned(), source.to_owned()];
        keys.into_iter().chain(values.map(|value| format!("{value:.5}"))).collect()
    };
    for (agent, loss) in training.losses.iter().enumerate() {
        let of_sources: Vec<[f64; 6]> = (0..loss.marginals.len())
            .map(|source| {
                let [training, held_out] = [&loss.training, &loss.held_out];
                [
                    training[0][source],
                    training[1][source],
                    held_out[0][source],
                    held_out[1][source],
                    loss.marginals[source],
                    loss.frequencies[source],
                ]
            })
            .collect();
        let agent = agent.to_string();
        lines.push(line(&agent, "all", &mean_of(&of_sources)));
        lines.extend(of_sources.iter().enumerate().map(|(source, values)| line(&agent, &source.to_string(), values)));
        of_agents.push(mean_of(&of_sources));
    }
    lines.insert(0, line(ALL_AGENTS, "all", &mean_of(&of_agents)));
    lines
}

fn mean_of(rows: &[[f64; 6]]) -> [f64; 6] {
    std::array::from_fn(|column| rows.iter().map(|row| row[column]).sum::<f64>() / rows.len() as f64)
}

fn training_header(training: &PolicyTraining) -> Line {
    let fixed = ["steps", "agent", "mean_return", "episodes", "surrogate", "value_loss", "entropy", "kl", "clipped"];
    let counters = training.counters.iter().map(|(name, _)| name.clone());
    fixed.into_iter().map(str::to_owned).chain(counters).collect()
}

/// A line for all agents with what the simulators counted, then one per agent.
fn training_lines(training: &PolicyTraining) -> Vec<Line> {
    let agents = training.agents.len() as f64;
    let mut total = super::ppo::Losses::default();
    training.agents.iter().for_each(|agent| total.add(&agent.losses, 1.0 / agents));
    let returns: Vec<f64> = training.agents.iter().filter_map(|agent| agent.mean_return).collect();
    let mean_return = (!returns.is_empty()).then(|| returns.iter().sum::<f64>() / returns.len() as f64);
    let episodes = training.agents.iter().map(|agent| agent.episodes).sum();
    let line = |agent: String, mean_return: Option<f64>, episodes: u64, losses: &super::ppo::Losses| {
        let mut line = vec![training.steps.to_string(), agent];
        line.push(mean_return.map_or(String::new(), |value| format!("{value:.4}")));
        line.push(episodes.to_string());
        let losses = [losses.surrogate, losses.value, losses.entropy, losses.kl, losses.clipped];
        line.extend(losses.map(|value| format!("{value:.5}")));
        line
    };
    let mut all = line(ALL_AGENTS.to_owned(), mean_return, episodes, &total);
    all.extend(training.counters.iter().map(|(_, count)| count.to_string()));
    let mut lines = vec![all];
    for (index, agent) in training.agents.iter().enumerate() {
        let mut of_agent = line(index.to_string(), agent.mean_return, agent.episodes, &agent.losses);
        of_agent.extend(training.counters.iter().map(|_| String::new()));
        lines.push(of_agent);
    }
    lines
}

/// Appends lines to a CSV file in one write; a new file begins with the header.
fn append(path: &Path, header: &Line, lines: &[Line]) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let mut file = OpenOptions::new().append(true).create(true).open(path).with_context(failed)?;
    let mut writer = csv::Writer::from_writer(Vec::new());
    if file.metadata().with_context(failed)?.len() == 0 {
        writer.write_record(header)?;
    }
    for line in lines {
        writer.write_record(line)?;
    }
    let block = writer.into_inner().context("a CSV block in memory")?;
    file.write_all(&block).with_context(failed)
}

/// Writes a file beside its place and moves it there: readers see the old one or the new one, whole.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let beside = path.with_extension("part");
    let mut file = File::create(&beside).with_context(failed)?;
    file.write_all(bytes).and_then(|()| file.sync_all()).with_context(failed)?;
    std::fs::rename(&beside, path).with_context(failed)
}
