//! The run directory: what a run leaves behind, written as it goes.
//!
//! CSV files grow by whole blocks of lines, one write per block; everything else is written beside its place and moved
//! there. So a kill loses at most the current period, and what is there can be read at any time.
//!
//! | file | what |
//! |---|---|
//! | `config.toml`, `networks/` | the checked config and the SUMO networks it names: the run can be evaluated anywhere |
//! | `run.json` | seed, command line, build and machine |
//! | `returns.csv` | evaluations on the GS, per agent and for all |
//! | `episodes.csv` | the mean return of all agents in each episode of each evaluation |
//! | `training.csv` | each period of training, per agent: returns on the simulator it trained on, losses |
//! | `aip_loss.csv` | each training of the AIPs, per agent and source |
//! | `aip_drift.csv` | the loss of the AIPs on fresh episodes, per agent, where the config asks for it |
//! | `timing.csv` | each period, per worker: seconds per phase |
//! | `memory.csv` | each period, per process: memory |
//! | `events.out.tfevents` | the numbers of these for TensorBoard, where the config asks for it |
//! | `policies.safetensors`, `aips.safetensors` | the networks, `[agents, ...]` |
//! | `checkpoints/` | the last few states to resume from |

use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result};

use super::answers::{FleetLoad, PolicyTraining};
use super::checkpoint::{self, Checkpoint, Progress};
use super::drift::{Drift, Moment};
use super::events::{Scalar, first_record, scalars_of, scalars_record};
use super::files::{self, append, append_block, cut, lock, write_atomically};
use super::finite::{check_aips, check_policies};
use super::fleet::Fleet;
use super::joint_layout::JointLayout;
use super::observer::{Interrupted, Observer};
use super::state::AgentsState;
use super::tables::{
    AIP_COLUMNS, DRIFT_COLUMNS, EPISODE_COLUMNS, Line, MEMORY_COLUMNS, Wall, aip_lines, drift_lines, episode_lines,
    evaluation_header, evaluation_lines, memory_lines, timing_header, timing_lines, training_header, training_lines,
};
use crate::config::Config;
use crate::domain::Kinds;
use crate::evaluation::Evaluation;
use crate::influence::{AipLoss, FreshLoss};

/// Writes a run down.
pub struct RunLog {
    dir: PathBuf,
    observer: Rc<dyn Observer>,
    layouts: Layouts,
    tensorboard: bool,
    /// From which to go on, until [`RunLog::begin`] has done so.
    resume_from: Option<Checkpoint>,
    periods_done: usize,
    /// Timesteps per agent at the last exchange.
    steps: u64,
    drift: Drift,
    /// Wall time of the run before this process.
    elapsed_before: Duration,
    begun: Instant,
    begun_period: Instant,
    /// Held as long as this process may write.
    _lock: File,
}

/// Where the networks that are saved keep their weights and biases.
pub struct Layouts {
    pub policies: JointLayout,
    pub aips: JointLayout,
}

impl Layouts {
    pub fn of(config: &Config, kinds: &Kinds) -> Layouts {
        Layouts {
            policies: JointLayout::of_policies(kinds, &config.policy),
            aips: JointLayout::of_aips(kinds, config.simulator, &config.aip),
        }
    }
}

impl RunLog {
    /// Writes a new run into `dir`, which exists and holds none.
    pub fn create(dir: &Path, config: &Config, layouts: Layouts, observer: Rc<dyn Observer>) -> Result<Self> {
        let now = Instant::now();
        Ok(RunLog {
            dir: dir.to_owned(),
            observer,
            layouts,
            tensorboard: config.logging.tensorboard,
            resume_from: None,
            periods_done: 0,
            steps: 0,
            drift: Drift::default(),
            elapsed_before: Duration::ZERO,
            begun: now,
            begun_period: now,
            _lock: lock(dir)?,
        })
    }

    /// Goes on with the run in `dir` from its newest checkpoint, or from its beginning where it has none yet.
    ///
    /// What was written after the checkpoint is cut off: it will be written again, the same.
    pub fn resume(dir: &Path, config: &Config, layouts: Layouts, observer: Rc<dyn Observer>) -> Result<Self> {
        let mut log = RunLog::create(dir, config, layouts, observer)?;
        let checkpoint = Checkpoint::read_newest(&dir.join(files::CHECKPOINTS))?;
        let progress = checkpoint.as_ref().map_or(Progress::default(), |checkpoint| checkpoint.progress.clone());
        for name in files::GROWING {
            cut(&dir.join(name), progress.file_lengths.get(name).copied().unwrap_or(0))?;
        }
        log.periods_done = progress.periods_done;
        log.drift = progress.drift;
        log.elapsed_before = Duration::from_secs_f64(progress.elapsed_s);
        log.resume_from = checkpoint;
        Ok(log)
    }

    /// Timesteps per agent at the checkpoint that the run goes on from; 0 where it begins.
    pub fn resumes_at(&self) -> u64 {
        self.resume_from.as_ref().map_or(0, |checkpoint| checkpoint.agents.steps)
    }

    /// How many periods of the schedule the run has behind it.
    pub fn periods_done(&self) -> usize {
        self.periods_done
    }

    /// How the loss of the AIPs on fresh episodes has grown since their last training.
    pub fn drift(&self) -> &Drift {
        &self.drift
    }

    /// Puts the fleet where the run stands.
    pub fn begin(&mut self, fleet: &mut dyn Fleet) -> Result<()> {
        self.resume_from.take().map_or(Ok(()), |checkpoint| fleet.restore(checkpoint.agents))?;
        self.steps = fleet.agents().steps;
        Ok(())
    }

    /// An evaluation of the joint policy.
    pub fn evaluated(&mut self, fleet: &dyn Fleet, evaluation: &Evaluation) -> Result<()> {
        let steps = fleet.agents().steps;
        self.append(files::RETURNS, steps, &evaluation_header(evaluation), &evaluation_lines(steps, evaluation))?;
        let columns = EPISODE_COLUMNS.map(str::to_owned);
        self.append(files::EPISODES, steps, &columns, &episode_lines(steps, evaluation))?;
        self.observer.evaluated(steps, evaluation);
        Ok(())
    }

    /// A training of the AIPs. What has diverged is an error and is not written.
    pub fn aips_trained(&mut self, fleet: &dyn Fleet, losses: &[AipLoss]) -> Result<()> {
        let agents = fleet.agents();
        check_aips(agents, losses)?;
        self.append(files::AIP_LOSS, agents.steps, &AIP_COLUMNS.map(str::to_owned), &aip_lines(agents.steps, losses))?;
        let stack = self.layouts.aips.write(&agents.aips, &about(agents.steps))?;
        write_atomically(&self.dir.join(files::AIPS), &stack)?;
        self.observer.aips_trained(agents.steps, losses);
        Ok(())
    }

    /// The loss of the AIPs on fresh episodes, after an evaluation or a training.
    pub fn aips_measured(&mut self, fleet: &dyn Fleet, after: Moment, losses: &[FreshLoss]) -> Result<()> {
        let steps = fleet.agents().steps;
        let lines = drift_lines(steps, after, losses);
        self.append(files::AIP_DRIFT, steps, &DRIFT_COLUMNS.map(str::to_owned), &lines)?;
        self.drift.note(after, losses);
        self.observer.aips_measured(losses, &self.drift);
        Ok(())
    }

    /// A period of training is over. Writes a checkpoint, and stops the run here if somebody asked for that. What has
    /// diverged is an error and is not written.
    pub fn period_done(&mut self, fleet: &mut dyn Fleet, training: &PolicyTraining) -> Result<()> {
        let load = fleet.take_load();
        let agents = fleet.agents();
        check_policies(training, agents)?;
        self.append(
            files::TRAINING,
            agents.steps,
            &training_header(training),
            &training_lines(agents.steps, training),
        )?;
        let stack = self.layouts.policies.write(&agents.policies, &about(agents.steps))?;
        write_atomically(&self.dir.join(files::POLICIES), &stack)?;
        self.append_load(agents, load)?;
        self.periods_done += 1;
        let progress = Progress {
            periods_done: self.periods_done,
            file_lengths: self.file_lengths()?,
            elapsed_s: (self.elapsed_before + self.begun.elapsed()).as_secs_f64(),
            drift: self.drift,
        };
        checkpoint::write(&self.dir.join(files::CHECKPOINTS), agents, progress)?;
        if self.observer.stop_requested() {
            return Err(Interrupted.into());
        }
        Ok(())
    }

    /// The last evaluation is over.
    pub fn finished(&mut self, fleet: &mut dyn Fleet) -> Result<()> {
        let load = fleet.take_load();
        self.append_load(fleet.agents(), load)
    }

    fn append_load(&mut self, agents: &AgentsState, load: FleetLoad) -> Result<()> {
        let steps = agents.steps;
        let now = Instant::now();
        let wall = Wall {
            period: now - self.begun_period,
            elapsed: self.elapsed_before + (now - self.begun),
            exchange: (now - self.begun_period).saturating_sub(load.at_work),
        };
        self.append(files::TIMING, steps, &timing_header(), &timing_lines(steps, &load, &wall))?;
        self.append(files::MEMORY, steps, &MEMORY_COLUMNS.map(str::to_owned), &memory_lines(steps, &load))?;
        if steps > self.steps {
            let agent_steps = (steps - self.steps) * agents.agents() as u64;
            let per_second = agent_steps as f64 / wall.period.as_secs_f64();
            self.tell_tensorboard(steps, &[("timing/agent_steps_per_s".to_owned(), per_second as f32)])?;
        }
        (self.steps, self.begun_period) = (steps, now);
        Ok(())
    }

    fn append(&self, file: &str, steps: u64, header: &[String], lines: &[Line]) -> Result<()> {
        append(&self.dir.join(file), header, lines)?;
        self.tell_tensorboard(steps, &scalars_of(file, header, lines))
    }

    fn tell_tensorboard(&self, steps: u64, scalars: &[Scalar]) -> Result<()> {
        if !self.tensorboard || scalars.is_empty() {
            return Ok(());
        }
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64());
        append_block(&self.dir.join(files::EVENTS), |new| {
            let first = if new { first_record(now) } else { Vec::new() };
            Ok([first, scalars_record(now, steps, scalars)].concat())
        })
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
    use crate::base::Ragged;
    use crate::config::Period;
    use crate::domain::Domain;
    use crate::domain::toy::Coins;
    use crate::influence::AipLoss;
    use crate::influence::Dataset;
    use crate::nn::Layout;
    use crate::training::answers::AgentTraining;
    use crate::training::collect::Purpose;
    use crate::training::observer::Silent;
    use crate::training::ppo::{Decayed, Losses};
    use crate::training::state::JointMoments;

    /// A fleet whose agents have become this; it does no work.
    struct Resting(AgentsState);

    impl Fleet for Resting {
        fn agents(&self) -> &AgentsState {
            &self.0
        }

        fn restore(&mut self, _agents: AgentsState) -> Result<()> {
            unreachable!("a test of the log orders nothing")
        }

        fn evaluate(&mut self, _episodes: usize) -> Result<Evaluation> {
            unreachable!("a test of the log orders nothing")
        }

        fn measure_aips(&mut self, _datasets: Vec<Dataset>) -> Result<Vec<FreshLoss>> {
            unreachable!("a test of the log orders nothing")
        }

        fn collect_datasets(&mut self, _purpose: Purpose) -> Result<Vec<Dataset>> {
            unreachable!("a test of the log orders nothing")
        }

        fn train_aips(&mut self, _datasets: Vec<Dataset>, _period: &Period) -> Result<Vec<AipLoss>> {
            unreachable!("a test of the log orders nothing")
        }

        fn train_policies(&mut self, _period: &Period) -> Result<PolicyTraining> {
            unreachable!("a test of the log orders nothing")
        }

        fn take_load(&mut self) -> FleetLoad {
            FleetLoad::default()
        }
    }

    /// Two agents with a policy of two parameters each, and what a period brought them.
    fn period(policy: [f32; 4], value_loss: f64) -> (PolicyTraining, Resting) {
        let losses = [0.0, value_loss].map(|value| Losses { value, ..Losses::default() });
        let agents = losses.map(|losses| AgentTraining { mean_return: None, episodes: 0, losses });
        let decayed = Decayed { learning_rate: 1e-3, clip: 0.1 };
        let table = |values: &[f32]| Ragged::from_vec(values.to_vec(), [2, 2]).unwrap();
        let moments = JointMoments { first: table(&[0.0; 4]), second: table(&[0.0; 4]), steps: 1 };
        let state =
            AgentsState { steps: 128, policies: table(&policy), moments, aips: table(&[0.0; 4]), streams: vec![] };
        (PolicyTraining { agents: agents.to_vec(), counters: Vec::new(), decayed }, Resting(state))
    }

    fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
        let files = [dir.to_owned(), dir.join(files::CHECKPOINTS)].map(|dir| fs::read_dir(dir).unwrap());
        let paths = files.into_iter().flatten().map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
        paths.map(|path| (path.clone(), fs::read(path).unwrap())).collect()
    }

    #[test]
    fn learning_that_diverged_is_not_written_over_what_was_good() {
        let dir = tempfile::tempdir().unwrap();
        let config: Config = toml::from_str("warehouse = { agents_per_side = 2 }").unwrap();
        let coins = Coins::new(1);
        let layout = || JointLayout::new(coins.kinds(), |_| Layout::new(vec![("w".to_owned(), vec![2])]));
        let layouts = Layouts { policies: layout(), aips: layout() };
        let mut log = RunLog::create(dir.path(), &config, layouts, Rc::new(Silent)).unwrap();
        let (training, mut fleet) = period([1.0, 2.0, 3.0, 4.0], 0.5);
        log.period_done(&mut fleet, &training).unwrap();
        let good = contents(dir.path());
        assert!(good.keys().any(|path| path.ends_with(files::POLICIES)) && good.len() >= 4);
        for ((policy, loss), what) in [
            (([1.0, 2.0, f32::NAN, 4.0], 0.5), "a parameter"),
            (([1.0, 2.0, 3.0, f32::INFINITY], 0.5), "a parameter"),
            (([1.0, 2.0, 3.0, 4.0], f64::NAN), "a loss"),
        ] {
            let (training, mut fleet) = period(policy, loss);
            let error = log.period_done(&mut fleet, &training).unwrap_err().to_string();
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
        fleet.0.aips = Ragged::from_vec(vec![0.0, 0.0, 0.0, f32::NAN], [2, 2]).unwrap();
        let error = log.aips_trained(&fleet, &[loss.clone(), loss]).unwrap_err().to_string();
        assert!(error.starts_with("agent 1: its AIP diverged") && error.contains("aip.learning_rate"), "{error}");
        assert!(contents(dir.path()) == good);
    }
}
