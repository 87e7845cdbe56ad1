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
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use super::answers::{AipTraining, FleetLoad, PolicyTraining};
use super::checkpoint::{Checkpoint, Progress};
use super::files::{self, append, cut, lock, write_atomically};
use super::finite::{check_aips, check_policies};
use super::fleet::Fleet;
use super::observer::{Interrupted, Observer};
use super::state::AgentsState;
use super::tables::{
    AIP_COLUMNS, Line, MEMORY_COLUMNS, Wall, aip_lines, evaluation_header, evaluation_lines, memory_lines,
    timing_header, timing_lines, training_header, training_lines,
};
use crate::evaluation::Evaluation;
use crate::nn::{Layout, write_stack};

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

fn about(steps: u64) -> HashMap<String, String> {
    HashMap::from([("steps".to_owned(), steps.to_string())])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Rows;
    use crate::influence::AipLoss;
    use crate::nn::Moments;
    use crate::training::answers::AgentTraining;
    use crate::training::observer::Silent;
    use crate::training::ppo::{Decayed, Losses};

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
}
