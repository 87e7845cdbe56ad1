//! `train`: trains the policies of all agents and writes a run directory.

use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{anyhow, ensure};

use super::run_name::default_dir;
use super::team::{Plan, Team};
use super::watch::Beside;
use crate::cli;
use crate::program::PROGRAM;
use dials_core::base::{counted, for_terminal};
use dials_core::domain::Domain;
use dials_core::outside::{Directory, Whereabouts, folder_of, quoted, read_text};
use dials_learn::config::{Simulator, rest_of_schedule};
use dials_learn::dials;
use dials_learn::fleet::Fleet;
use dials_learn::observer::Interrupted;
use dials_learn::progress::TrainingProgress;
use dials_session::build::{other_build, record_resume};
use dials_session::config::resume::with_end;
use dials_session::config::{LARGEST_FILE as LARGEST_CONFIG, RunConfig, load};
use dials_session::directory;
use dials_session::domains::{self, DomainConfig};
use dials_session::error::{Error, Result};
use dials_session::fleet::children::FILES_PER_WORKER;
use dials_session::machine::allow_open_files;
use dials_session::places::Existing;
use dials_session::python::{Link, predictor};
use dials_session::records::checkpoint::newest_step;
use dials_session::records::checkpoint::owner::{NotOfThisRun, Owner};
use dials_session::records::files;
use dials_session::records::networks::Layouts;
use dials_session::records::resume_point::{NothingFits, ResumePoint};
use dials_session::records::run_json::{RunJson, Versions};
use dials_session::records::run_log::Diverged;
use dials_session::records::run_log::RunLog;
use dials_session::records::run_record::RunRecord;
use dials_session::terminal::training::Progress;
use dials_session::terminal::{answer, note, program, warn};
use dials_traffic::config::TrafficTable;

pub(super) fn train(args: &cli::TrainArgs) -> Result<()> {
    let Some(team) = Team::join(args)? else { return Ok(()) };
    let asked = team.asked(args).or_else(|| remembered(args));
    let wanted = asked.as_ref().map(|(workers, _)| *workers);
    let run = match (&args.resume, &args.config) {
        (Some(dir), _) => resume(args, dir, wanted)?,
        (None, Some(config)) => begin(args, config, wanted)?,
        (None, None) => unreachable!("clap asks for one of them"),
    };
    if run.has_ended {
        return answer(how_to_go_on(run.directory.path(), &run.config, &*run.domain)).map_err(Error::Run);
    }
    let workers = run.workers(asked);
    remember(&run.directory, args.workers).map_err(Error::Run)?;
    note(run.plan(workers).map_err(Error::Run)?);
    let patience = Duration::from_secs(args.patience);
    let _view = args.dashboard.then(|| Beside::of(run.directory.path())).transpose().map_err(Error::Run)?;
    let (directory, config, domain) = (run.directory.clone(), run.config.clone(), run.domain.clone());
    let outcome = run.train(team, workers, patience);
    // The path may lead elsewhere by now.
    let place = match directory.whereabouts() {
        Whereabouts::InPlace => Some(directory.path().to_owned()),
        Whereabouts::Moved(place) => Some(place),
        Whereabouts::Removed => None,
    };
    match (outcome, place) {
        (Ok(()), Some(place)) => {
            if place != directory.path() {
                let (path, place) = (directory.path().display(), place.display());
                warn(format_args!("warning: {path}: was moved to {place} while this run was written"));
            }
            answer(how_to_go_on(&place, &config, &*domain)).map_err(Error::Run)
        }
        (Ok(()), None) => {
            let path = directory.path().display();
            Err(Error::Run(anyhow!("{path}: was removed while this run was written")))
        }
        (Err(error), place) if error.is::<Interrupted>() => {
            let last_words = |place: PathBuf| stopped(&directory, &place, config.learning.end());
            Err(Error::Interrupted(place.map_or("stopped".to_owned(), last_words)))
        }
        (Err(error), place) => {
            if let Some(place) = place.filter(|_| !error.is::<Diverged>()) {
                let way_out = format!("the files written so far are kept; resume with: {}", resume_command(&place));
                warn(way_out);
            }
            Err(Error::Run(error))
        }
    }
}

/// Returns an error if the learner or the predictor of the config is in a Python process, and none has started this one.
fn ensure_python(config: &RunConfig) -> anyhow::Result<()> {
    ensure!(
        !config.learning.learns_outside() || Link::is_there(),
        "algorithm = \"outside\": the learner is written in Python: run it with dials_traffic.dials(...), as docs/python.md says"
    );
    ensure!(
        !config.learning.predicts_outside() || Link::is_there(),
        "predictor = \"outside\": the predictor is written in Python: run it with dials_traffic.train(..., predictor=...), as \
         docs/python.md says"
    );
    Ok(())
}

/// A run that is ready to begin or to resume.
struct Run {
    directory: Directory,
    config: RunConfig,
    domain: Arc<dyn Domain>,
    /// What of the run its checkpoints carry.
    owner: Owner,
    /// Point from which the run continues. `None`: it is new.
    resumed: Option<ResumePoint>,
    has_ended: bool,
    /// This build, if another build wrote the run so far.
    other_build: Option<Versions>,
}

/// Makes a new run. `wanted`: number of workers that was asked for.
fn begin(args: &cli::TrainArgs, config_path: &Path, wanted: Option<usize>) -> Result<Run> {
    let config = load(config_path, &settings(args)).map_err(Error::Usage)?;
    ensure_python(&config).map_err(Error::Usage)?;
    let domain = domains::find(&config).map_err(Error::Usage)?;
    domains::check_for_training(&config, &*domain).map_err(Error::Usage)?;
    domains::note_left_out(&*domain);
    if config.learning.simulator != Simulator::Global {
        domains::note_without_locally(&*domain);
    }
    if let Some(sumo) = domains::sumo(&config).map_err(Error::Usage)?
        && !sumo.version.is_tried()
    {
        warn(format_args!("warning: {} is newer than all that was tried with this program", sumo.name));
    }
    allow_workers(workers(wanted, &config, domain.agents()))?;
    let existing = match (args.force, &args.out) {
        (true, _) => Existing::MoveAside,
        (false, Some(_)) => Existing::Refuse,
        (false, None) => Existing::Number,
    };
    let dir = args.out.clone().unwrap_or_else(|| default_dir(config_path, &config, &args.settings.all()));
    let directory = directory::create(&dir, existing, &config, PROGRAM).map_err(Error::Usage)?;
    // Use the networks of the run directory from here on, because the original ones may just have been moved aside.
    open(directory, domains::open_untried)
}

/// Opens a run to continue it, to another end if `--steps` says so. `wanted`: number of workers that was asked for.
fn resume(args: &cli::TrainArgs, dir: &Path, wanted: Option<usize>) -> Result<Run> {
    directory::check(dir).map_err(Error::Usage)?;
    let directory = Directory::lock(dir).map_err(Error::Run)?;
    let before = args.steps.map(|steps| end_at(&directory, steps)).transpose().map_err(Error::Usage)?;
    resume_locked(args, dir, directory.clone(), wanted).inspect_err(|_| {
        // A refused end leaves the run as it was.
        if let Some(Err(error)) = before.map(|before| directory.write(files::CONFIG, before.as_bytes())) {
            warn(format_args!("warning: {error:#}"));
        }
    })
}

fn resume_locked(args: &cli::TrainArgs, dir: &Path, directory: Directory, wanted: Option<usize>) -> Result<Run> {
    let run = open(directory, domains::open)?;
    ensure_python(&run.config).map_err(Error::Usage)?;
    allow_workers(workers(wanted, &run.config, run.domain.agents()))?;
    let other_build = other_build(PROGRAM, dir, &run.config, args.accept_other_build).map_err(Error::Usage)?;
    let point = ResumePoint::find(&run.directory, &run.owner).map_err(|error| {
        if error.is::<NotOfThisRun>() {
            return Error::Usage(error);
        }
        if error.is::<NothingFits>() {
            let (program, config, run) = (program(), quoted(&dir.join(files::CONFIG)), quoted(dir));
            warn(format_args!(
                "put the file back from a copy; or move this run aside and begin it again with: {program} train {config} \
                 --out {run} --force"
            ));
        }
        Error::Run(error)
    })?;
    point.warning.iter().for_each(warn);
    let layouts = Layouts::of(&run.config.learning, run.domain.kinds());
    for name in layouts.restore(&run.directory, &run.config, &point).map_err(Error::Run)? {
        let file = run.directory.path_of(name);
        note(format_args!("note: {}: was lost or damaged; made again from the checkpoint", file.display()));
    }
    let has_ended = has_ended(dir, &run.config, &point);
    Ok(Run { resumed: Some(point), has_ended, other_build, ..run })
}

/// Reads the config and the networks of a run directory. `opened`: how its domain is opened.
fn open(directory: Directory, opened: fn(&RunConfig) -> anyhow::Result<Arc<dyn Domain>>) -> Result<Run> {
    let (config, domain) = directory::open_config(directory.path(), opened).map_err(Error::Usage)?;
    let owner = Owner::of(&config, &*domain).map_err(Error::Usage)?;
    Ok(Run { directory, config, domain, owner, resumed: None, has_ended: false, other_build: None })
}

/// Makes the run end at step `steps`, by its config. Returns the text of the config before.
fn end_at(directory: &Directory, steps: u64) -> anyhow::Result<String> {
    let path = directory.path().join(files::CONFIG);
    let config = load(&path, &[])?;
    ensure!(
        steps <= config.learning.total_steps,
        "--steps {steps}: this run can go to step {0} only, because its learning rate and clip range have decayed to \
         nothing there (total_steps = {0}); for a longer one begin a new run with --set total_steps={steps}",
        config.learning.total_steps
    );
    let text = read_text(&path, LARGEST_CONFIG)?;
    directory.write(files::CONFIG, with_end(&text, steps).as_bytes())?;
    Ok(text)
}

/// Returns whether nothing is left to do, and then says how to train further. Otherwise says if the resumed run loses the
/// evaluation of an earlier end: its files are those of a run that was never stopped.
fn has_ended(dir: &Path, config: &RunConfig, point: &ResumePoint) -> bool {
    let Some(checkpoint) = &point.checkpoint else { return false };
    let (steps, standing) = (checkpoint.agents.steps, &checkpoint.progress.standing);
    let (learning, rest) = (&config.learning, rest_of_schedule(&config.learning, standing.until));
    let run = RunRecord::read(dir).ok();
    let evaluation = run.as_ref().and_then(|run| run.evaluation_at(steps));
    let is_final = evaluation.is_some_and(|last| last.episode_returns.len() == learning.evaluation.final_episodes);
    let has_ended = rest.is_empty() && is_final && run.as_ref().is_some_and(RunRecord::is_whole);
    if has_ended {
        let (program, run, total) = (program(), quoted(dir), learning.total_steps);
        let further = match steps < total {
            true => format!("train it further with: {program} train --resume {run} --steps {total}"),
            false => "for a longer one begin a new run with a larger total_steps".to_owned(),
        };
        note(format_args!("note: this run has ended, at step {steps}\n  {further}"));
    } else if rest.first().is_some_and(|next| !next.evaluate)
        && standing.evaluated_at != Some(steps)
        && evaluation.is_some()
    {
        note(format_args!(
            "note: {} loses the evaluation at step {steps}, the earlier end of this run.\n  A run that goes on is not \
             evaluated there (evaluation.every_steps = {}).",
            files::RETURNS,
            learning.evaluation.every_steps
        ));
    }
    has_ended
}

impl Run {
    /// Returns how many workers to start, not more than have work, and says so if they are fewer than were asked for.
    fn workers(&self, asked: Option<(usize, String)>) -> usize {
        let agents = self.domain.agents();
        let workers = workers(asked.as_ref().map(|(asked, _)| *asked), &self.config, agents);
        if let Some((_, words)) = asked.filter(|(asked, _)| *asked > workers) {
            let agents = counted(agents, "agent");
            note(for_terminal(&format!(
                "note: {words}: starting {workers}, because there are {agents} and never more than {workers} episodes or \
                 agents to share out"
            )));
        }
        workers
    }

    fn plan(&self, workers: usize) -> anyhow::Result<String> {
        let Run { directory, config, domain, .. } = self;
        let at = if workers == 0 { "this process".to_owned() } else { counted(workers, "worker") };
        let begins = if self.resumed.is_some() { "resuming" } else { "training" };
        Ok(format!(
            "{begins} {}: {}, simulator {}, {at}\n  up to step {} per agent, into {}\n  \
             sampled policies; +-: half of a 95 % interval over an evaluation's episodes",
            domain.scenario()?.id.word(),
            counted(domain.agents(), "agent"),
            config.learning.short_form().name,
            config.learning.end(),
            directory.path().display()
        ))
    }

    fn train(self, team: Team, workers: usize, patience: Duration) -> anyhow::Result<()> {
        let Run { directory, config, domain, owner, resumed, other_build, .. } = self;
        let config = &config;
        let (kept, end) = (directory.clone(), config.learning.end());
        let last_words = move || stopped(&kept, kept.path(), end);
        let progress = Rc::new(Progress::new(config, domain.agents(), last_words)?);
        let layouts = Layouts::of(&config.learning, domain.kinds());
        let (mut log, checkpoint) = match resumed {
            None => (RunLog::begin(directory.clone(), owner, layouts), None),
            Some(point) => RunLog::resume(directory.clone(), point, owner, layouts)?,
        };
        let resumes_at = checkpoint.as_ref().map_or(0, |checkpoint| checkpoint.agents.steps);
        other_build.as_ref().map_or(Ok(()), |build| record_resume(&directory, build, resumes_at))?;
        predictor::install(config, &*domain);
        let plan = Plan { domain: &domain, config, directory: &directory, workers, patience };
        let mut fleet = team.fleet(&plan, progress.clone())?;
        let mut standing = TrainingProgress::default();
        if let Some(checkpoint) = checkpoint {
            standing = checkpoint.progress.standing;
            fleet.restore(checkpoint.agents)?;
        }
        let outcome = dials::train(&config.learning, &mut fleet, standing, &mut log, &*progress);
        progress.finish(outcome.is_ok());
        outcome
    }
}

/// Returns the number of workers that a run was begun with, if it was asked for then.
fn remembered(args: &cli::TrainArgs) -> Option<(usize, String)> {
    let workers = RunJson::read(args.resume.as_deref()?).ok()?.workers?;
    Some((workers, format!("--workers {workers}, as before")))
}

/// Writes the number of workers that was asked for into `run.json`, so that a resume uses it again.
fn remember(directory: &Directory, workers: Option<usize>) -> anyhow::Result<()> {
    let Some(workers) = workers else { return Ok(()) };
    let run = RunJson::read(directory.path())?;
    if run.workers == Some(workers) { Ok(()) } else { RunJson { workers: Some(workers), ..run }.write(directory) }
}

/// Returns how many workers to start: not more than have work.
fn workers(asked: Option<usize>, config: &RunConfig, agents: usize) -> usize {
    let (learning, evaluation) = (&config.learning, &config.learning.evaluation);
    if learning.learns_outside() {
        // One learner decides for all agents, in training and in episodes on the GS.
        return asked.unwrap_or(1).min(1);
    }
    let imitated = learning.policy.imitate.as_ref().map_or(0, |_| learning.imitation.episodes(config.horizon()));
    let datasets = learning.dataset_episodes(config.horizon()).max(learning.first_dataset_episodes(config.horizon()));
    // At some time of the run each has an agent or an episode.
    let shared = [evaluation.episodes, evaluation.final_episodes, evaluation.aip_loss_episodes, datasets, imitated];
    asked.unwrap_or_else(cores).min(shared.into_iter().fold(agents, usize::max))
}

fn allow_workers(workers: usize) -> Result<()> {
    allow_open_files(workers, FILES_PER_WORKER, "--workers").map_err(Error::Usage)
}

/// Returns the flags that override keys of the config, as `KEY=VALUE` settings.
fn settings(args: &cli::TrainArgs) -> Vec<String> {
    let mut settings = settings_with(&args.settings.all(), args.simulator.as_deref());
    settings.extend(args.seed.map(|seed| format!("seed={seed}")));
    settings.extend(args.steps.map(|steps| format!("stop_at_steps={steps}")));
    settings.extend(args.tensorboard.then(|| "logging.tensorboard=true".to_owned()));
    settings
}

pub(super) fn settings_with(settings: &[String], simulator: Option<&str>) -> Vec<String> {
    settings.iter().cloned().chain(simulator.map(|name| format!("simulator={name}"))).collect()
}

pub(super) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Returns the last line of a run that was stopped. `place`: where its directory is now.
fn stopped(directory: &Directory, place: &Path, end: u64) -> String {
    let kept = match newest_step(directory) {
        Ok(Some(step)) => format!("stopped; kept up to step {step} of {end} per agent"),
        // The resume says what cannot be read.
        Ok(None) | Err(_) => "stopped; there is no checkpoint yet, so it will begin again".to_owned(),
    };
    format!("{kept}; resume with: {}", resume_command(place))
}

fn resume_command(dir: &Path) -> String {
    format!("{} train --resume {}", program(), quoted(dir))
}

/// Returns the commands to try next. They use the run's copy of the config, which includes the command-line flags.
fn how_to_go_on(dir: &Path, config: &RunConfig, domain: &dyn Domain) -> String {
    let episodes = config.learning.evaluation.final_episodes;
    let (program, place, run) = (program(), dir.display(), quoted(dir));
    let kept = quoted(&dir.join(files::CONFIG));
    let mut commands = format!("\nwritten to {place}; repeat its last evaluation with:\n  {program} evaluate {run}");
    if let Some(rival) = domain.rival() {
        let command = format!("{program} baseline {kept} --controller {rival}");
        let episodes = counted(episodes, "episode");
        commands += &format!("\nand measure a controller on the same {episodes} with:\n  {command}");
    }
    if let Some(DomainConfig::Traffic(TrafficTable::Scenario(_))) = &config.domain {
        let plan =
            quoted(&dir.with_file_name(format!("{}_plan", dir.file_name().unwrap_or_default().to_string_lossy())));
        commands += &format!("\nand make a plan for the street of it with:\n  {program} plan {run} --out {plan}");
    }
    if config.logging.tensorboard {
        let runs = quoted(folder_of(dir));
        commands += &format!("\nand watch it next to other runs with:\n  tensorboard --logdir {runs}");
    }
    commands
}
