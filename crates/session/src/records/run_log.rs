//! The [`Recorder`] that writes a run directory during the run.

use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::Result;

use super::checkpoint::owner::Owner;
use super::checkpoint::{self, Checkpoint, RunProgress};
use super::files;
use super::growing::{GrowingFile, Mark};
use super::lines::{
    Wall, aip_lines, drift_lines, episode_lines, evaluation_lines, imitation_lines, memory_lines, timing_lines,
    training_lines,
};
use super::networks::Layouts;
use super::resume_point::ResumePoint;
use super::tensorboard::{Scalar, first_record, scalars_of, scalars_record};
use dials_core::base::Ragged;
use dials_core::domain::Kinds;
use dials_core::outside::Directory;
use dials_learn::algorithms;
use dials_learn::algorithms::imitation::ImitationLoss;
use dials_learn::config::Config;
use dials_learn::evaluation::Evaluation;
use dials_learn::evaluation::csv::Lines;
use dials_learn::fleet::FleetLoad;
use dials_learn::observer::Recorder;
use dials_learn::predictors::{AipLoss, FreshLoss};
use dials_learn::progress::{Moment, TrainingProgress};
use dials_learn::state::AgentsState;
use dials_learn::steps::train_policies::PolicyTraining;

pub struct RunLog {
    /// Run directory, which is locked as long as this process may write.
    directory: Directory,
    growing: BTreeMap<&'static str, GrowingFile>,
    layouts: Layouts,
    owner: Owner,
    /// Timesteps per agent at the last exchange.
    steps: u64,
    /// Wall time of the run before this process.
    elapsed_before: Duration,
    begun: Instant,
    begun_period: Instant,
}

impl RunLog {
    /// Starts a new run in a directory that this process has locked and that holds no run.
    pub fn begin(directory: Directory, owner: Owner, layouts: Layouts) -> Self {
        let now = Instant::now();
        RunLog {
            directory,
            growing: files::GROWING.map(|name| (name, GrowingFile::new(name, Mark::default()))).into(),
            layouts,
            owner,
            steps: 0,
            elapsed_before: Duration::ZERO,
            begun: now,
            begun_period: now,
        }
    }

    /// Continues a run in a locked directory from a point, and returns its checkpoint. What came later is cut off.
    pub fn resume(
        directory: Directory,
        point: ResumePoint,
        owner: Owner,
        layouts: Layouts,
    ) -> Result<(Self, Option<Checkpoint>)> {
        let mut log = RunLog::begin(directory, owner, layouts);
        if let Some(folder) = log.directory.subdirectory(files::CHECKPOINTS)? {
            point.newer.iter().try_for_each(|name| folder.remove(name))?;
            folder.sync()?;
        }
        log.growing = files::GROWING.map(|name| (name, GrowingFile::new(name, point.mark(name)))).into();
        log.growing.values().try_for_each(|file| file.cut(&log.directory))?;
        let progress = point.checkpoint.as_ref().map(|checkpoint| &checkpoint.progress);
        log.elapsed_before = Duration::from_secs_f64(progress.map_or(0.0, |progress| progress.elapsed_s));
        Ok((log, point.checkpoint))
    }

    fn append_load(&mut self, agents: &AgentsState, load: FleetLoad) -> Result<()> {
        let steps = agents.steps;
        let now = Instant::now();
        let wall = Wall {
            period: now - self.begun_period,
            elapsed: self.elapsed_before + (now - self.begun),
            exchange: (now - self.begun_period).saturating_sub(load.at_work),
        };
        self.append(files::MEMORY, steps, &memory_lines(steps, &load))?;
        // Last: an experiment takes a run whose last times are there for finished.
        self.append(files::TIMING, steps, &timing_lines(steps, &load, &wall))?;
        if steps > self.steps {
            let agent_steps = (steps - self.steps) * agents.agents() as u64;
            let per_second = agent_steps as f64 / wall.period.as_secs_f64();
            self.append_scalars(steps, &[("timing/agent_steps_per_s".to_owned(), per_second as f32)])?;
        }
        (self.steps, self.begun_period) = (steps, now);
        Ok(())
    }

    fn append(&mut self, file: &str, steps: u64, lines: &Lines) -> Result<()> {
        self.growing.get_mut(file).expect("the file grows").append_lines(&self.directory, lines)?;
        self.append_scalars(steps, &scalars_of(file, lines))
    }

    /// Appends numbers to the file for TensorBoard, if the config asks for it.
    fn append_scalars(&mut self, steps: u64, scalars: &[Scalar]) -> Result<()> {
        if !self.owner.config.logging.tensorboard || scalars.is_empty() {
            return Ok(());
        }
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64());
        self.growing.get_mut(files::EVENTS).expect("the file grows").append(&self.directory, |new| {
            let first = if new { first_record(now) } else { Vec::new() };
            Ok([first, scalars_record(now, steps, scalars)].concat())
        })
    }

    fn write_checkpoint(&mut self, agents: &AgentsState, standing: &TrainingProgress) -> Result<()> {
        let progress = RunProgress {
            standing: standing.clone(),
            growing: self.sync()?,
            elapsed_s: (self.elapsed_before + self.begun.elapsed()).as_secs_f64(),
        };
        let folder = self.directory.make_subdirectory(files::CHECKPOINTS);
        let written = folder.and_then(|folder| checkpoint::write(&folder, &self.owner, agents, progress));
        // That it went away explains every other error.
        self.directory.check_in_place()?;
        written
    }

    /// Makes everything written so far durable, so that a checkpoint may count on it. Returns how far the files are.
    fn sync(&mut self) -> Result<BTreeMap<String, Mark>> {
        self.growing.values_mut().try_for_each(|file| file.sync(&self.directory))?;
        self.directory.sync()?;
        let marks = self.growing.iter().map(|(&name, file)| (name.to_owned(), file.mark()));
        Ok(marks.filter(|(_, mark)| mark.bytes > 0).collect())
    }
}

impl Recorder for RunLog {
    fn begun(&mut self, agents: &AgentsState) -> Result<()> {
        self.steps = agents.steps;
        Ok(())
    }

    /// Policies that have diverged are an error.
    fn imitated(&mut self, agents: &AgentsState, losses: &[ImitationLoss]) -> Result<()> {
        check_imitation(agents, losses)?;
        self.append(files::IMITATION, agents.steps, &imitation_lines(agents.steps, losses))
    }

    fn evaluated(&mut self, agents: &AgentsState, evaluation: &Evaluation) -> Result<()> {
        let steps = agents.steps;
        self.append(files::RETURNS, steps, &evaluation_lines(steps, evaluation))?;
        self.append(files::EPISODES, steps, &episode_lines(steps, evaluation))
    }

    /// Networks that have diverged are an error and are not written.
    fn aips_trained(&mut self, agents: &AgentsState, losses: &[AipLoss]) -> Result<()> {
        check_aips(agents, losses)?;
        self.append(files::AIP_LOSS, agents.steps, &aip_lines(agents.steps, losses))?;
        self.layouts.aips.write(&self.directory, files::AIPS, &agents.aips, agents.steps)
    }

    fn aips_measured(&mut self, agents: &AgentsState, after: Moment, losses: &[FreshLoss]) -> Result<()> {
        self.append(files::AIP_DRIFT, agents.steps, &drift_lines(agents.steps, after, losses))
    }

    /// Also writes a checkpoint. Networks that have diverged are an error and are not written.
    fn period_done(
        &mut self,
        agents: &AgentsState,
        standing: &TrainingProgress,
        training: &PolicyTraining,
        load: FleetLoad,
    ) -> Result<()> {
        check_policies(training, agents, &self.owner.config.learning, &self.owner.kinds, self.steps)?;
        self.append(files::TRAINING, agents.steps, &training_lines(agents.steps, training))?;
        self.layouts.policies.write(&self.directory, files::POLICIES, &agents.policies, agents.steps)?;
        self.append_load(agents, load)?;
        self.write_checkpoint(agents, standing)
    }

    /// Networks that have diverged are an error and are not written.
    fn saved(&mut self, agents: &AgentsState, standing: &TrainingProgress) -> Result<()> {
        if let Some(so_far) = &standing.so_far {
            check_policies(so_far, agents, &self.owner.config.learning, &self.owner.kinds, self.steps)?;
        }
        self.write_checkpoint(agents, standing)
    }

    fn finished(&mut self, agents: &AgentsState, load: FleetLoad) -> Result<()> {
        self.append_load(agents, load)?;
        self.sync().map(drop)
    }
}

/// The error about learning that has diverged. A resume would diverge again.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Diverged(String);

/// Returns an error that names the first agent whose policy has diverged. `begun`: timestep at which the period began.
fn check_policies(
    training: &PolicyTraining,
    state: &AgentsState,
    config: &Config,
    kinds: &Kinds,
    begun: u64,
) -> Result<()> {
    let algorithm = algorithms::of(config);
    let [first, last] = [begun + algorithm.steps_per_update() as u64, state.steps]
        .map(|steps| algorithm.learning_rate_key(config, steps));
    let key = if first == last { last.to_owned() } else { format!("{first} or {last}") };
    let mut losses = training.metrics.of_agents.iter().filter(|_| training.updates > 0);
    let bad_loss = losses.find_map(|(_, values)| values.iter().position(|value| !value.is_finite()));
    check("policy", state.steps, &key, "a loss", bad_loss)?;
    check("policy", state.steps, &key, "a parameter", first_bad_row(&state.policies))?;
    let tables = kinds.iter().flat_map(|kind| algorithm.layout(config, kind, state.steps).numbers);
    for name in tables.filter(|table| table.learnt).map(|table| table.name) {
        let what = format!("a value of its table `{name}`");
        check("policy", state.steps, &key, &what, first_bad_row(&state.learners.numbers[name]))?;
    }
    Ok(())
}

/// Returns an error that names the first agent whose policy has diverged while it imitated a controller.
fn check_imitation(agents: &AgentsState, losses: &[ImitationLoss]) -> Result<()> {
    let bad_loss = losses.iter().position(|loss| !loss.cross_entropy.iter().all(|value| value.is_finite()));
    let key = "imitation.learning_rate";
    check("imitation", agents.steps, key, "a loss", bad_loss)?;
    check("imitation", agents.steps, key, "a parameter", first_bad_row(&agents.policies))
}

/// Returns an error that names the first agent whose AIP has diverged.
fn check_aips(agents: &AgentsState, losses: &[AipLoss]) -> Result<()> {
    let of_sources = |loss: &AipLoss| loss.training.iter().chain(&loss.held_out).flatten().all(|loss| loss.is_finite());
    let key = "aip.learning_rate";
    check("AIP", agents.steps, key, "a loss", losses.iter().position(|loss| !of_sources(loss)))?;
    check("AIP", agents.steps, key, "a parameter", first_bad_row(&agents.aips))
}

fn first_bad_row(table: &Ragged<f32>) -> Option<usize> {
    table.iter().position(|row| !row.iter().all(|value| value.is_finite()))
}

/// `bad`: the first agent for which `what` is no finite number. `key`: what to lower.
fn check(whose: &str, steps: u64, key: &str, what: &str, bad: Option<usize>) -> Result<()> {
    let Some(agent) = bad else { return Ok(()) };
    Err(Diverged(format!(
        "agent {agent}: its {whose} diverged before step {steps}: {what} is no longer a finite number; it was not \
         written, so what was written before is intact; lower {key} and begin a new run, because a resume keeps the \
         settings"
    ))
    .into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::path::{Path, PathBuf};

    use crate::config::RunConfig;
    use crate::records::networks::JointLayout;
    use crate::records::run_json::RunJson;
    use crate::records::run_record::{AipTrainingRecord, FreshLossRecord, RunRecord};
    use dials_core::base::{Activity, Rows, Timesheet};
    use dials_core::domain::{Domain, Measures, Scenario};
    use dials_learn::algorithms::{Metrics, Tables};
    use dials_learn::fleet::{Footprint, WorkerLoad};
    use dials_learn::steps::train_policies::AgentTraining;
    use dials_testkit::toy::Coins;
    use stacknets::Layout;

    const CONFIG: &str = "warehouse = { agents_per_side = 2 }\n";

    fn begin(dir: &Path) -> RunLog {
        let coins = Coins::new(1);
        let layout = || JointLayout::new(coins.kinds(), |_| Layout::new(vec![("w".to_owned(), vec![2])]));
        let owner = Owner::of(&toml::from_str(CONFIG).unwrap(), &coins).unwrap();
        RunLog::begin(Directory::lock(dir).unwrap(), owner, Layouts { policies: layout(), aips: layout() })
    }

    /// Returns two agents with a policy of two parameters each, and the results of a period.
    fn period(policy: [f32; 4], value_loss: f64) -> (PolicyTraining, AgentsState) {
        let agents = vec![AgentTraining::default(); 2];
        let losses = ("value_loss".to_owned(), vec![0.0, value_loss]);
        let metrics = Metrics { of_agents: vec![losses], settings: vec![("clip".to_owned(), 0.1)] };
        let table = |values: &[f32]| Ragged::from_vec(values.to_vec(), [2, 2]).unwrap();
        let moments = ["first_moments", "second_moments"].map(|name| (name.to_owned(), table(&[0.0; 4])));
        let learners = Tables { numbers: moments.into(), ..Tables::default() };
        let (policies, aips) = (table(&policy), table(&[0.0; 4]));
        let state = AgentsState { steps: 128, policies, learners, aips, streams: vec![], outside_aips: vec![] };
        (PolicyTraining { agents, metrics, updates: 1, counters: Vec::new() }, state)
    }

    fn loss(before: f64, after: f64) -> AipLoss {
        AipLoss {
            training: [vec![9.0], vec![9.0]],
            held_out: [vec![before], vec![after]],
            marginals: vec![0.5],
            frequencies: vec![0.25],
            on_marginals: Vec::new(),
        }
    }

    fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
        let files = [dir.to_owned(), dir.join(files::CHECKPOINTS)].map(|dir| fs::read_dir(dir).unwrap());
        let paths = files.into_iter().flatten().map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
        paths.map(|path| (path.clone(), fs::read(path).unwrap())).collect()
    }

    #[test]
    fn what_the_log_writes_the_reader_reads() {
        let dir = tempfile::tempdir().unwrap();
        let mut log = begin(dir.path());
        fs::write(dir.path().join(files::CONFIG), CONFIG).unwrap();
        RunJson::new(Scenario::new("ants", 2, 5), Vec::new(), 1).write(&log.directory).unwrap();
        let (training, agents) = period([1.0, 2.0, 3.0, 4.0], 0.5);
        // Agents' means 2 and 4; episode means 1 and 5: deviation sqrt(8), standard error sqrt(8 / 2) = 2.
        let returns = Rows::from_vec(vec![0.0, 2.0, 4.0, 6.0], 2);
        let played = Evaluation { returns, measures: Measures::default(), stuck: vec![false, true] };
        log.evaluated(&agents, &played).unwrap();
        log.aips_trained(&agents, &[loss(0.75, 0.25), loss(0.25, 0.25)]).unwrap();
        let fresh = FreshLoss { predictor: vec![0.375], marginals: vec![0.5] };
        log.aips_measured(&agents, Moment::Training, &[fresh.clone(), fresh]).unwrap();
        let mut timesheet = Timesheet::default();
        timesheet.note(Activity::Evaluation, Duration::from_secs(3), &Default::default());
        timesheet.note(Activity::Collection, Duration::from_secs(2), &Default::default());
        timesheet.note_cpu(Duration::from_secs(7));
        let mebibytes = |peak: u64, shared: u64| Footprint { peak_rss_kib: peak << 10, pss_kib: shared << 10 };
        let worker = WorkerLoad { timesheet, footprint: mebibytes(30, 20) };
        let load = FleetLoad { workers: vec![worker], coordinator: Some(mebibytes(40, 10)), ..FleetLoad::default() };
        log.period_done(&agents, &TrainingProgress::default(), &training, load).unwrap();

        let read = RunRecord::read(dir.path()).unwrap();
        let [found] = &read.evaluations[..] else { panic!("{:?}", read.evaluations) };
        assert_eq!((found.steps, found.all.mean, found.all.std_error, found.all.stuck), (128, 3.0, 2.0, 1));
        assert_eq!((found.agents[1].mean, found.agents[1].stuck), (4.0, 1));
        assert_eq!(found.episode_returns, [1.0, 5.0]);
        let AipTrainingRecord { steps, before, after, marginals } = read.aip_trainings[0];
        assert_eq!((steps, before, after, marginals), (128, 0.5, 0.25, 0.5));
        let FreshLossRecord { after_training, loss, marginals, .. } = read.fresh_losses[0];
        assert_eq!((after_training, loss, marginals), (true, 0.375, 0.5));
        let time = read.total_time().unwrap();
        assert_eq!((time.evaluation_s, time.influence_s, time.cpu.total_s), (3.0, 2.0, 7.0));
        let memory = read.memory.unwrap();
        assert_eq!((memory.process_mb, memory.total_mb, memory.total_pss_mb), (40.0, 70.0, 30.0));
        assert_eq!(read.workers, 1);
    }

    #[test]
    fn learning_that_diverged_is_not_written_over_what_was_good() {
        let dir = tempfile::tempdir().unwrap();
        let mut log = begin(dir.path());
        let mut write = |policy, loss| {
            let (training, agents) = period(policy, loss);
            log.period_done(&agents, &TrainingProgress::default(), &training, FleetLoad::default())
        };
        write([1.0, 2.0, 3.0, 4.0], 0.5).unwrap();
        let good = contents(dir.path());
        assert!(good.keys().any(|path| path.ends_with(files::POLICIES)) && good.len() >= 4);
        for (policy, loss, what) in [
            ([1.0, 2.0, f32::NAN, 4.0], 0.5, "a parameter"),
            ([1.0, 2.0, 3.0, f32::INFINITY], 0.5, "a parameter"),
            ([1.0, 2.0, 3.0, 4.0], f64::NAN, "a loss"),
        ] {
            let error = write(policy, loss).unwrap_err().to_string();
            assert!(error.starts_with("agent 1: its policy diverged before step 128: "), "{error}");
            assert!(error.contains(what) && error.contains("lower ppo.learning_rate"), "{error}");
            assert!(contents(dir.path()) == good);
        }
        let (training, mut agents) = period([1.0, 2.0, f32::NAN, 4.0], 0.5);
        agents.aips = Ragged::from_vec(vec![0.0, 0.0, 0.0, f32::NAN], [2, 2]).unwrap();
        let error = log.aips_trained(&agents, &[loss(0.1, 0.1), loss(0.1, 0.1)]).unwrap_err().to_string();
        assert!(error.starts_with("agent 1: its AIP diverged") && error.contains("aip.learning_rate"), "{error}");
        assert!(contents(dir.path()) == good);
        // After an imitation the critic learns alone at first, with the rate of the imitation.
        let mut imitates = RunConfig::default().learning;
        imitates.policy.imitate = Some("a".to_owned());
        for (steps, key) in [
            (128, "lower imitation.learning_rate and begin"),
            (imitates.critic_steps() + 1280, "lower imitation.learning_rate or ppo.learning_rate"),
        ] {
            agents.steps = steps;
            let checked = check_policies(&training, &agents, &imitates, Coins::new(1).kinds(), 0);
            let error = checked.unwrap_err().to_string();
            assert!(error.contains(key), "{error}");
        }
    }
}
