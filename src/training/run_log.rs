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
//! | `timing.csv` | each period, per worker: seconds per phase |
//! | `memory.csv` | each period, per process: memory |
//! | `policies.safetensors`, `aips.safetensors` | the networks, `[agents, ...]` |
//! | `checkpoints/` | the last few states to resume from |

use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use super::checkpoint::{Checkpoint, Progress};
use super::finite::{check_aips, check_policies};
use super::fleet::{AipTraining, Fleet, FleetLoad, PolicyTraining};
use super::footprint::Footprint;
use super::observer::{Interrupted, Observer};
use super::ppo::Losses;
use super::state::AgentsState;
use crate::base::{Phase, Stopwatch};
use crate::evaluation::{Evaluation, Summary};
use crate::nn::{Layout, write_stack};

/// The names of the files of a run directory.
pub mod files {
    pub const CONFIG: &str = "config.toml";
    pub const NETWORKS: &str = "networks";
    pub const RUN: &str = "run.json";
    pub const RETURNS: &str = "returns.csv";
    pub const TRAINING: &str = "training.csv";
    pub const AIP_LOSS: &str = "aip_loss.csv";
    pub const TIMING: &str = "timing.csv";
    pub const MEMORY: &str = "memory.csv";
    pub const POLICIES: &str = "policies.safetensors";
    pub const AIPS: &str = "aips.safetensors";
    pub const CHECKPOINTS: &str = "checkpoints";

    /// The files that grow as the run goes.
    pub const GROWING: [&str; 5] = [RETURNS, TRAINING, AIP_LOSS, TIMING, MEMORY];
}

/// Writes a run down.
pub struct RunLog {
    dir: PathBuf,
    observer: Rc<dyn Observer>,
    layouts: Layouts,
    /// From which to go on, until [`RunLog::begin`] has done so.
    resume_from: Option<Checkpoint>,
    periods_done: usize,
    /// Wall time of the run before this process.
    elapsed_before: Duration,
    begun: Instant,
    begun_period: Instant,
    /// Held as long as this process may write.
    _lock: File,
}

/// Where the networks that are saved keep their weights and biases.
pub struct Layouts {
    pub policies: Layout,
    pub aips: Layout,
}

impl RunLog {
    /// Writes a new run into `dir`, which exists and holds none.
    pub fn create(dir: &Path, layouts: Layouts, observer: Rc<dyn Observer>) -> Result<Self> {
        let now = Instant::now();
        Ok(RunLog {
            dir: dir.to_owned(),
            observer,
            layouts,
            resume_from: None,
            periods_done: 0,
            elapsed_before: Duration::ZERO,
            begun: now,
            begun_period: now,
            _lock: lock(dir)?,
        })
    }

    /// Goes on with the run in `dir` from its newest checkpoint, or from its beginning where it has none yet.
    ///
    /// What was written after the checkpoint is cut off: it will be written again, the same.
    pub fn resume(dir: &Path, layouts: Layouts, observer: Rc<dyn Observer>) -> Result<Self> {
        let mut log = RunLog::create(dir, layouts, observer)?;
        let checkpoint = Checkpoint::read_newest(&dir.join(files::CHECKPOINTS))?;
        let progress = checkpoint.as_ref().map_or(Progress::default(), |checkpoint| checkpoint.progress.clone());
        for name in files::GROWING {
            cut(&dir.join(name), progress.file_lengths.get(name).copied().unwrap_or(0))?;
        }
        log.periods_done = progress.periods_done;
        log.elapsed_before = Duration::from_secs_f64(progress.elapsed_s);
        log.resume_from = checkpoint;
        Ok(log)
    }

    /// How many periods of the schedule the run has behind it.
    pub fn periods_done(&self) -> usize {
        self.periods_done
    }

    /// Puts the fleet where the run stands and returns the state of its agents.
    pub fn begin(&mut self, fleet: &mut dyn Fleet) -> Result<AgentsState> {
        match self.resume_from.take() {
            None => fleet.state(),
            Some(checkpoint) => {
                fleet.restore(&checkpoint.agents)?;
                Ok(checkpoint.agents)
            }
        }
    }

    /// An evaluation of the joint policy.
    pub fn evaluated(&mut self, steps: u64, evaluation: &Evaluation) -> Result<()> {
        self.append(files::RETURNS, &evaluation_header(evaluation), &evaluation_lines(steps, evaluation))?;
        self.observer.evaluated(steps, evaluation);
        Ok(())
    }

    /// A training of the AIPs. Where it diverged nothing is written.
    pub fn aips_trained(&mut self, steps: u64, training: &AipTraining) -> Result<()> {
        check_aips(steps, training)?;
        self.append(files::AIP_LOSS, &AIP_COLUMNS.map(str::to_owned), &aip_lines(steps, training))?;
        let stack = write_stack(&self.layouts.aips, &training.parameters, &about(steps))?;
        write_atomically(&self.dir.join(files::AIPS), &stack)?;
        self.observer.aips_trained(steps, training);
        Ok(())
    }

    /// A period of training is over and `agents` is what came of it. Writes a checkpoint, and stops the run here if
    /// somebody asked for that. Where learning diverged nothing is written.
    pub fn period_done(&mut self, training: &PolicyTraining, agents: &AgentsState, load: FleetLoad) -> Result<()> {
        check_policies(training, agents)?;
        self.append(files::TRAINING, &training_header(training), &training_lines(agents.steps, training))?;
        let stack = write_stack(&self.layouts.policies, &agents.policies, &about(agents.steps))?;
        write_atomically(&self.dir.join(files::POLICIES), &stack)?;
        self.append_load(agents.steps, load)?;
        self.periods_done += 1;
        let progress = Progress {
            periods_done: self.periods_done,
            file_lengths: self.file_lengths()?,
            elapsed_s: (self.elapsed_before + self.begun.elapsed()).as_secs_f64(),
        };
        Checkpoint { agents: agents.clone(), progress }.write(&self.dir.join(files::CHECKPOINTS))?;
        if self.observer.stop_requested() {
            return Err(Interrupted.into());
        }
        Ok(())
    }

    /// The last evaluation is over.
    pub fn finished(&mut self, steps: u64, load: FleetLoad) -> Result<()> {
        self.append_load(steps, load)
    }

    fn append_load(&mut self, steps: u64, load: FleetLoad) -> Result<()> {
        let now = Instant::now();
        let wall = Wall {
            period: now - self.begun_period,
            elapsed: self.elapsed_before + (now - self.begun),
            exchange: (now - self.begun_period).saturating_sub(load.at_work),
        };
        self.append(files::TIMING, &timing_header(), &timing_lines(steps, &load, &wall))?;
        self.append(files::MEMORY, &MEMORY_COLUMNS.map(str::to_owned), &memory_lines(steps, &load))?;
        self.begun_period = now;
        Ok(())
    }

    fn append(&self, file: &str, header: &[String], lines: &[Line]) -> Result<()> {
        append(&self.dir.join(file), header, lines)
    }

    fn file_lengths(&self) -> Result<BTreeMap<String, u64>> {
        let mut lengths = BTreeMap::new();
        for name in files::GROWING {
            let path = self.dir.join(name);
            if path.exists() {
                let metadata = fs::metadata(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
                lengths.insert(name.to_owned(), metadata.len());
            }
        }
        Ok(lengths)
    }
}

/// Makes sure that one process at a time writes a run; the system lifts the lock when the process ends, however.
fn lock(dir: &Path) -> Result<File> {
    let folder = File::open(dir).with_context(|| format!("{}: cannot be opened", dir.display()))?;
    folder.try_lock().with_context(|| format!("{}: another process is writing this run", dir.display()))?;
    Ok(folder)
}

/// Cuts a growing file to a length that it had before.
fn cut(path: &Path, length: u64) -> Result<()> {
    let failed = || format!("{}: cannot be cut to where its checkpoint left it", path.display());
    if length == 0 {
        return match fs::remove_file(path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error).with_context(failed),
            _ => Ok(()),
        };
    }
    let file = OpenOptions::new().write(true).open(path).with_context(failed)?;
    let now = file.metadata().with_context(failed)?.len();
    anyhow::ensure!(
        now >= length,
        "{}: has {now} bytes, but had {length} when the newest checkpoint was written: it was changed since",
        path.display()
    );
    file.set_len(length).with_context(failed)
}

type Line = Vec<String>;

const ALL: &str = "all";

fn about(steps: u64) -> HashMap<String, String> {
    HashMap::from([("steps".to_owned(), steps.to_string())])
}

fn evaluation_header(evaluation: &Evaluation) -> Line {
    let fixed = ["steps", "agent", "mean", "median", "std_error", "episodes", "stuck"];
    let per_agent = evaluation.measures.per_agent.iter().map(|(name, _)| name.clone());
    let system = evaluation.measures.system.iter().map(|(name, _)| name.clone());
    fixed.map(str::to_owned).into_iter().chain(per_agent).chain(system).collect()
}

/// A line for all agents (`stuck`: how many), then one per agent (`stuck`: 0 or 1; no figures of the whole system).
fn evaluation_lines(steps: u64, evaluation: &Evaluation) -> Vec<Line> {
    let line = |agent: String, summary: Summary, stuck: usize| {
        let mut line = vec![steps.to_string(), agent];
        line.extend([summary.mean, summary.median, summary.std_error].map(|value| format!("{value:.4}")));
        line.extend([evaluation.episodes().to_string(), stuck.to_string()]);
        line
    };
    let measures = &evaluation.measures;
    let mut all = line(ALL.to_owned(), evaluation.of_all(), evaluation.stuck.iter().filter(|&&stuck| stuck).count());
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
    lines.insert(0, line(ALL, "all", &mean_of(&of_agents)));
    lines
}

fn mean_of(rows: &[[f64; 6]]) -> [f64; 6] {
    std::array::from_fn(|column| rows.iter().map(|row| row[column]).sum::<f64>() / rows.len() as f64)
}

fn training_header(training: &PolicyTraining) -> Line {
    let fixed = ["steps", "agent", "mean_return", "episodes", "surrogate", "value_loss", "entropy", "kl", "clipped"];
    let fixed = fixed.into_iter().chain(["learning_rate", "clip"]);
    let counters = training.counters.iter().map(|(name, _)| name.clone());
    fixed.map(str::to_owned).chain(counters).collect()
}

/// A line for all agents with what the simulators counted, then one per agent.
fn training_lines(steps: u64, training: &PolicyTraining) -> Vec<Line> {
    let agents = training.agents.len() as f64;
    let mut total = Losses::default();
    training.agents.iter().for_each(|agent| total.add(&agent.losses, 1.0 / agents));
    let returns: Vec<f64> = training.agents.iter().filter_map(|agent| agent.mean_return).collect();
    let mean_return = (!returns.is_empty()).then(|| returns.iter().sum::<f64>() / returns.len() as f64);
    let episodes = training.agents.iter().map(|agent| agent.episodes).sum();
    let line = |agent: String, mean_return: Option<f64>, episodes: u64, losses: &Losses| {
        let mut line = vec![steps.to_string(), agent];
        line.push(mean_return.map_or(String::new(), |value| format!("{value:.4}")));
        line.push(episodes.to_string());
        let losses = [losses.surrogate, losses.value, losses.entropy, losses.kl, losses.clipped];
        line.extend(losses.map(|value| format!("{value:.5}")));
        line.extend([training.decayed.learning_rate, training.decayed.clip].map(|value| format!("{value:e}")));
        line
    };
    let mut all = line(ALL.to_owned(), mean_return, episodes, &total);
    all.extend(training.counters.iter().map(|(_, count)| count.to_string()));
    let mut lines = vec![all];
    for (index, agent) in training.agents.iter().enumerate() {
        let mut of_agent = line(index.to_string(), agent.mean_return, agent.episodes, &agent.losses);
        of_agent.extend(training.counters.iter().map(|_| String::new()));
        lines.push(of_agent);
    }
    lines
}

struct Wall {
    period: Duration,
    elapsed: Duration,
    exchange: Duration,
}

fn timing_header() -> Line {
    let phases = Phase::ALL.map(|phase| format!("{}_s", phase.name()));
    let fixed = ["steps", "worker", "wall_s", "elapsed_s", "exchange_s"].map(str::to_owned);
    fixed.into_iter().chain(phases).chain(["idle_s".to_owned()]).collect()
}

/// A line for the mean of all workers, then one per worker. What is neither a phase nor an exchange is idle.
fn timing_lines(steps: u64, load: &FleetLoad, wall: &Wall) -> Vec<Line> {
    let line = |worker: String, spent: &dyn Fn(fn(&Stopwatch) -> Duration) -> f64, phases: [f64; Phase::ALL.len()]| {
        let busy = spent(Stopwatch::total);
        let whole = [wall.period, wall.elapsed, wall.exchange].map(|time| time.as_secs_f64());
        let idle = (whole[0] - busy).max(0.0);
        let seconds = whole.into_iter().chain(phases).chain([idle]).map(|seconds| format!("{seconds:.3}"));
        [steps.to_string(), worker].into_iter().chain(seconds).collect::<Line>()
    };
    let workers = load.workers.len() as f64;
    let mean = |of: &dyn Fn(&Stopwatch) -> Duration| {
        load.workers.iter().map(|worker| of(&worker.watch).as_secs_f64()).sum::<f64>() / workers
    };
    let mean_phases = Phase::ALL.map(|phase| mean(&|watch| watch.spent(phase)));
    let mut lines = vec![line(ALL.to_owned(), &|of| mean(&of), mean_phases)];
    for (index, worker) in load.workers.iter().enumerate() {
        let phases = Phase::ALL.map(|phase| worker.watch.spent(phase).as_secs_f64());
        lines.push(line(index.to_string(), &|of| of(&worker.watch).as_secs_f64(), phases));
    }
    lines
}

const MEMORY_COLUMNS: [&str; 4] = ["steps", "process", "peak_rss_mb", "pss_mb"];

/// A line for the total, then one per process.
fn memory_lines(steps: u64, load: &FleetLoad) -> Vec<Line> {
    let workers = load.workers.iter().enumerate().map(|(index, worker)| (index.to_string(), worker.footprint));
    let coordinator = load.coordinator.map(|footprint| ("coordinator".to_owned(), footprint));
    let processes: Vec<(String, Footprint)> = workers.chain(coordinator).collect();
    let total = processes.iter().fold(Footprint::default(), |total, (_, process)| Footprint {
        peak_rss_kib: total.peak_rss_kib + process.peak_rss_kib,
        pss_kib: total.pss_kib + process.pss_kib,
    });
    let megabytes = |kib: u64| format!("{:.1}", kib as f64 / 1024.0);
    let line = |(process, footprint): (String, Footprint)| {
        vec![steps.to_string(), process, megabytes(footprint.peak_rss_kib), megabytes(footprint.pss_kib)]
    };
    std::iter::once((ALL.to_owned(), total)).chain(processes).map(line).collect()
}

/// Appends lines to a CSV file in one write; a new file begins with the header. Where that fails the file is as before.
fn append(path: &Path, header: &[String], lines: &[Line]) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let mut file = OpenOptions::new().append(true).create(true).open(path).with_context(failed)?;
    let before = file.metadata().with_context(failed)?.len();
    let mut writer = csv::Writer::from_writer(Vec::new());
    if before == 0 {
        writer.write_record(header)?;
    }
    for line in lines {
        writer.write_record(line)?;
    }
    let block = writer.into_inner().context("a CSV block in memory")?;
    file.write_all(&block).inspect_err(|_| drop(file.set_len(before))).with_context(failed)
}

/// Writes a file beside its place and moves it there: readers see the old one or the new one, whole.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let beside = path.with_extension("part");
    let mut file = File::create(&beside).with_context(failed)?;
    let written = file.write_all(bytes).and_then(|()| file.sync_all());
    written.inspect_err(|_| drop(fs::remove_file(&beside))).with_context(failed)?;
    fs::rename(&beside, path).with_context(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Rows;
    use crate::influence::AipLoss;
    use crate::nn::Moments;
    use crate::training::fleet::AgentTraining;
    use crate::training::observer::Silent;
    use crate::training::ppo::Decayed;
    use std::os::unix::fs::symlink;

    fn line(text: &str) -> Line {
        vec![text.to_owned()]
    }

    #[test]
    fn a_full_disk_is_a_clear_error_and_what_was_there_stays() {
        let dir = tempfile::tempdir().unwrap();
        // The kernel's own full disk.
        let full = dir.path().join("returns.csv");
        symlink("/dev/full", &full).unwrap();
        let error = format!("{:#}", append(&full, &line("a"), &[line("1")]).unwrap_err());
        assert!(error.contains("returns.csv: cannot be written: No space left on device"), "{error}");

        let kept = dir.path().join("policies.safetensors");
        write_atomically(&kept, b"good").unwrap();
        symlink("/dev/full", dir.path().join("policies.part")).unwrap();
        let error = format!("{:#}", write_atomically(&kept, b"newer").unwrap_err());
        assert!(error.contains("policies.safetensors: cannot be written: No space left on device"), "{error}");
        assert_eq!(fs::read(&kept).unwrap(), b"good");
        assert!(!dir.path().join("policies.part").exists());
    }

    /// Two agents with a policy of two parameters each, and what a period brought them.
    fn period(policy: [f32; 4], value_loss: f64) -> (PolicyTraining, AgentsState) {
        let losses = [0.0, value_loss].map(|value| Losses { value, ..Losses::default() });
        let agents = losses.map(|losses| AgentTraining { mean_return: None, episodes: 0, losses });
        let decayed = Decayed { learning_rate: 1e-3, clip: 0.1 };
        let table = |values: &[f32]| Rows::from_vec(values.to_vec(), 2);
        let moments = Moments { first: table(&[0.0; 4]), second: table(&[0.0; 4]), steps: 1 };
        let state = AgentsState { steps: 128, policies: table(&policy), moments, aips: table(&[0.0; 4]) };
        (PolicyTraining { agents: agents.to_vec(), counters: Vec::new(), decayed }, state)
    }

    fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
        let files = [dir.to_owned(), dir.join(files::CHECKPOINTS)].map(|dir| fs::read_dir(dir).unwrap());
        let paths = files.into_iter().flatten().map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
        paths.map(|path| (path.clone(), fs::read(path).unwrap())).collect()
    }

    #[test]
    fn learning_that_diverged_is_not_written_over_what_was_good() {
        let dir = tempfile::tempdir().unwrap();
        let layout = || Layout::new(vec![("w".to_owned(), vec![2])]);
        let layouts = Layouts { policies: layout(), aips: layout() };
        let mut log = RunLog::create(dir.path(), layouts, Rc::new(Silent)).unwrap();
        let (training, state) = period([1.0, 2.0, 3.0, 4.0], 0.5);
        log.period_done(&training, &state, FleetLoad::default()).unwrap();
        let good = contents(dir.path());
        assert!(good.keys().any(|path| path.ends_with(files::POLICIES)) && good.len() >= 4);
        for ((policy, loss), what) in [
            (([1.0, 2.0, f32::NAN, 4.0], 0.5), "a parameter"),
            (([1.0, 2.0, 3.0, f32::INFINITY], 0.5), "a parameter"),
            (([1.0, 2.0, 3.0, 4.0], f64::NAN), "a loss"),
        ] {
            let (training, state) = period(policy, loss);
            let error = log.period_done(&training, &state, FleetLoad::default()).unwrap_err().to_string();
            assert!(error.starts_with("agent 1: its policy diverged before step 128: "), "{error}");
            assert!(error.contains(what) && error.contains("lower ppo.learning_rate"), "{error}");
            assert!(contents(dir.path()) == good);
        }
        let loss = AipLoss {
            training: [vec![0.1], vec![0.1]],
            held_out: [vec![0.1], vec![0.1]],
            marginals: vec![0.1],
            frequencies: vec![0.5],
        };
        let parameters = Rows::from_vec(vec![0.0, 0.0, 0.0, f32::NAN], 2);
        let error = log.aips_trained(128, &AipTraining { losses: vec![loss; 2], parameters }).unwrap_err().to_string();
        assert!(error.starts_with("agent 1: its AIP diverged") && error.contains("aip.learning_rate"), "{error}");
        assert!(contents(dir.path()) == good);
    }

    #[test]
    fn a_growing_file_is_cut_to_where_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csv");
        append(&path, &line("header"), &[line("1"), line("2")]).unwrap();
        let length = fs::metadata(&path).unwrap().len();
        append(&path, &line("header"), &[line("3")]).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "header\n1\n2\n3\n");
        cut(&path, length).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "header\n1\n2\n");
        assert!(cut(&path, length + 1).unwrap_err().to_string().contains("it was changed since"));
        cut(&path, 0).unwrap();
        assert!(!path.exists());
        cut(&path, 0).unwrap();
    }
}
