//! The [`Recorder`] that writes a run directory during the run.

use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::Result;

use super::checkpoint::owner::Owner;
use super::checkpoint::{self, Checkpoint, RunProgress};
use super::columns;
use super::csv::block;
use super::files;
use super::finite::{check_aips, check_imitation, check_policies};
use super::growing::{GrowingFile, Mark};
use super::lines::{
    CsvLine, Wall, aip_header, aip_lines, drift_lines, episode_lines, evaluation_header, evaluation_lines, header,
    imitation_lines, memory_lines, timing_lines, training_header, training_lines,
};
use super::networks::Layouts;
use super::resume_point::ResumePoint;
use super::tensorboard::{Scalar, first_record, scalars_of, scalars_record};
use dials_core::outside::Directory;
use dials_learn::algorithms::imitation::ImitationLoss;
use dials_learn::evaluation::Evaluation;
use dials_learn::fleet::FleetLoad;
use dials_learn::observer::Recorder;
use dials_learn::predictors::{AipLoss, FreshLoss};
use dials_learn::progress::Moment;
use dials_learn::progress::TrainingProgress;
use dials_learn::state::AgentsState;
use dials_learn::steps::train_policies::PolicyTraining;

/// A journal that writes a run directory.
pub struct RunLog {
    /// Run directory, which is locked as long as this process may write.
    directory: Directory,
    /// Files that grow, in the order of [`files::GROWING`].
    growing: [GrowingFile; files::GROWING.len()],
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
            growing: files::GROWING.map(|name| GrowingFile::new(name, Mark::default())),
            layouts,
            owner,
            steps: 0,
            elapsed_before: Duration::ZERO,
            begun: now,
            begun_period: now,
        }
    }

    /// Continues a run in a directory that this process has locked, from a point of that run. Also returns the
    /// checkpoint of that point.
    ///
    /// Everything written after the checkpoint is cut off. It will be written again, with the same numbers.
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
        log.growing = files::GROWING.map(|name| GrowingFile::new(name, point.mark(name)));
        log.growing.iter().try_for_each(|file| file.cut(&log.directory))?;
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
        self.append(files::MEMORY, steps, &header(&columns::OF_MEMORY), &memory_lines(steps, &load))?;
        // Last: an experiment takes a run whose last times are there for finished.
        self.append(files::TIMING, steps, &columns::of_timing(), &timing_lines(steps, &load, &wall))?;
        if steps > self.steps {
            let agent_steps = (steps - self.steps) * agents.agents() as u64;
            let per_second = agent_steps as f64 / wall.period.as_secs_f64();
            self.tell_tensorboard(steps, &[("timing/agent_steps_per_s".to_owned(), per_second as f32)])?;
        }
        (self.steps, self.begun_period) = (steps, now);
        Ok(())
    }

    fn append(&mut self, file: &str, steps: u64, header: &[String], lines: &[CsvLine]) -> Result<()> {
        self.grow(file, |new| block(header, lines, new))?;
        self.tell_tensorboard(steps, &scalars_of(file, header, lines))
    }

    fn tell_tensorboard(&mut self, steps: u64, scalars: &[Scalar]) -> Result<()> {
        if !self.owner.config.logging.tensorboard || scalars.is_empty() {
            return Ok(());
        }
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64());
        self.grow(files::EVENTS, |new| {
            let first = if new { first_record(now) } else { Vec::new() };
            Ok([first, scalars_record(now, steps, scalars)].concat())
        })
    }

    fn grow(&mut self, file: &str, block: impl FnOnce(bool) -> Result<Vec<u8>>) -> Result<()> {
        let place = files::GROWING.iter().position(|name| *name == file).expect("the file grows");
        self.growing[place].append(&self.directory, block)
    }

    /// Makes everything written so far durable, so that a checkpoint may count on it. Returns how far the files are.
    fn sync(&mut self) -> Result<BTreeMap<String, Mark>> {
        self.growing.iter_mut().try_for_each(|file| file.sync(&self.directory))?;
        self.directory.sync()?;
        let marks = files::GROWING.iter().zip(&self.growing).map(|(name, file)| ((*name).to_owned(), file.mark()));
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
        let (steps, lines) = (agents.steps, imitation_lines(agents.steps, losses));
        self.append(files::IMITATION, steps, &header(&columns::OF_IMITATION), &lines)
    }

    fn evaluated(&mut self, agents: &AgentsState, evaluation: &Evaluation) -> Result<()> {
        let steps = agents.steps;
        self.append(files::RETURNS, steps, &evaluation_header(evaluation), &evaluation_lines(steps, evaluation))?;
        self.append(files::EPISODES, steps, &header(&columns::OF_EPISODES), &episode_lines(steps, evaluation))
    }

    /// Networks that have diverged are an error and are not written.
    fn aips_trained(&mut self, agents: &AgentsState, losses: &[AipLoss]) -> Result<()> {
        check_aips(agents, losses)?;
        self.append(files::AIP_LOSS, agents.steps, &aip_header(losses), &aip_lines(agents.steps, losses))?;
        self.layouts.write_aips(&self.directory, agents, agents.steps)
    }

    fn aips_measured(&mut self, agents: &AgentsState, after: Moment, losses: &[FreshLoss]) -> Result<()> {
        let lines = drift_lines(agents.steps, after, losses);
        self.append(files::AIP_DRIFT, agents.steps, &header(&columns::OF_AIP_DRIFT), &lines)
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
        self.append(
            files::TRAINING,
            agents.steps,
            &training_header(training),
            &training_lines(agents.steps, training),
        )?;
        self.layouts.write_policies(&self.directory, agents)?;
        self.append_load(agents, load)?;
        let progress = RunProgress {
            standing: *standing,
            growing: self.sync()?,
            elapsed_s: (self.elapsed_before + self.begun.elapsed()).as_secs_f64(),
        };
        let folder = self.directory.make_subdirectory(files::CHECKPOINTS);
        let written = folder.and_then(|folder| checkpoint::write(&folder, &self.owner, agents, progress));
        // That it went away explains every other error.
        self.directory.check_in_place()?;
        written
    }

    fn finished(&mut self, agents: &AgentsState, load: FleetLoad) -> Result<()> {
        self.append_load(agents, load)?;
        self.sync().map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::path::{Path, PathBuf};

    use crate::config::RunConfig;
    use crate::records::joint_layout::JointLayout;
    use dials_core::base::Ragged;
    use dials_core::domain::Domain;
    use dials_learn::algorithms::{Metrics, Tables};
    use dials_learn::predictors::AipLoss;
    use dials_learn::steps::train_policies::AgentTraining;
    use dials_testkit::toy::Coins;
    use stacknets::Layout;

    /// Returns two agents with a policy of two parameters each, and the results of a period.
    fn period(policy: [f32; 4], value_loss: f64) -> (PolicyTraining, AgentsState) {
        let agents = vec![AgentTraining { mean_return: None, episodes: 0 }; 2];
        let losses = ("value_loss".to_owned(), vec![0.0, value_loss]);
        let metrics = Metrics { of_agents: vec![losses], settings: vec![("clip".to_owned(), 0.1)] };
        let table = |values: &[f32]| Ragged::from_vec(values.to_vec(), [2, 2]).unwrap();
        let moments = ["first_moments", "second_moments"].map(|name| (name.to_owned(), table(&[0.0; 4])));
        let learners = Tables { numbers: moments.into(), ..Tables::default() };
        let (policies, aips) = (table(&policy), table(&[0.0; 4]));
        let state = AgentsState { steps: 128, policies, learners, aips, streams: vec![] };
        (PolicyTraining { agents, metrics, updates: 1, counters: Vec::new() }, state)
    }

    fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
        let files = [dir.to_owned(), dir.join(files::CHECKPOINTS)].map(|dir| fs::read_dir(dir).unwrap());
        let paths = files.into_iter().flatten().map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
        paths.map(|path| (path.clone(), fs::read(path).unwrap())).collect()
    }

    #[test]
    fn learning_that_diverged_is_not_written_over_what_was_good() {
        let dir = tempfile::tempdir().unwrap();
        let config: RunConfig = toml::from_str("warehouse = { agents_per_side = 2 }").unwrap();
        let coins = Coins::new(1);
        let layout = || JointLayout::new(coins.kinds(), |_| Layout::new(vec![("w".to_owned(), vec![2])]));
        let layouts = Layouts { policies: layout(), aips: layout() };
        let mut log = RunLog::begin(Directory::lock(dir.path()).unwrap(), Owner::of(&config, &coins).unwrap(), layouts);
        let standing = TrainingProgress::default();
        let (training, mut agents) = period([1.0, 2.0, 3.0, 4.0], 0.5);
        log.period_done(&agents, &standing, &training, FleetLoad::default()).unwrap();
        let good = contents(dir.path());
        assert!(good.keys().any(|path| path.ends_with(files::POLICIES)) && good.len() >= 4);
        for ((policy, loss), what) in [
            (([1.0, 2.0, f32::NAN, 4.0], 0.5), "a parameter"),
            (([1.0, 2.0, 3.0, f32::INFINITY], 0.5), "a parameter"),
            (([1.0, 2.0, 3.0, 4.0], f64::NAN), "a loss"),
        ] {
            let (training, agents) = period(policy, loss);
            let outcome = log.period_done(&agents, &standing, &training, FleetLoad::default());
            let error = outcome.unwrap_err().to_string();
            assert!(error.starts_with("agent 1: its policy diverged before step 128: "), "{error}");
            assert!(error.contains(what) && error.contains("lower ppo.learning_rate"), "{error}");
            assert!(contents(dir.path()) == good);
        }
        // After an imitation the critic learns alone at first, with the rate of the imitation.
        let (training, mut agents_now) = period([1.0, 2.0, f32::NAN, 4.0], 0.5);
        let mut imitates = config.learning.clone();
        imitates.policy.imitate = Some("a".to_owned());
        let error =
            check_policies(&training, &agents_now, &imitates, Coins::new(1).kinds(), 0).unwrap_err().to_string();
        assert!(error.contains("lower imitation.learning_rate and begin"), "{error}");
        agents_now.steps = imitates.critic_steps() + 1280;
        let error =
            check_policies(&training, &agents_now, &imitates, Coins::new(1).kinds(), 0).unwrap_err().to_string();
        assert!(error.contains("lower imitation.learning_rate or ppo.learning_rate"), "{error}");
        let loss = AipLoss {
            training: [vec![0.1], vec![0.1]],
            held_out: [vec![0.1], vec![0.1]],
            marginals: vec![0.1],
            frequencies: vec![0.5],
            on_marginals: Vec::new(),
        };
        agents.aips = Ragged::from_vec(vec![0.0, 0.0, 0.0, f32::NAN], [2, 2]).unwrap();
        let error = log.aips_trained(&agents, &[loss.clone(), loss]).unwrap_err().to_string();
        assert!(error.starts_with("agent 1: its AIP diverged") && error.contains("aip.learning_rate"), "{error}");
        assert!(contents(dir.path()) == good);
    }
}
