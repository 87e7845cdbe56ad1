//! `experiment`: makes all runs of a file that are not finished yet, in parallel on the cores of this machine.
//!
//! Every run is a `train` in its own process, which ends when this one ends. All progress is in the run directories. So
//! an experiment that was killed resumes when it is called again.
//!
//! - `plan`: the tasks, with their estimated time and memory. `child`: one running process.

mod child;
mod plan;

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, ensure};

use super::subject::controller_file;
use super::train::cores as machine_cores;
use crate::cli;
use crate::program::PROGRAM;
use child::{RunProcess, Said, log_obstacle};
use dials_core::base::counted;
use dials_core::outside::{Busy, Directory, quoted};
use dials_session::build::other_build;
use dials_session::domains;
use dials_session::error::{Error, Result};
use dials_session::experiment::LOGS;
use dials_session::experiment::file::{Experiment, Knowledge};
use dials_session::experiment::progress::{Stage, directory, stage};
use dials_session::experiment::schedule::Cores;
use dials_session::machine::allow_open_files;
use dials_session::outputs::check_not_a_run;
use dials_session::records::find::{BASELINES, ExperimentPlan, FolderPlan, MeasuredWith, PLAN};
use dials_session::terminal::experiment::Display;
use dials_session::terminal::{Wish, answer, program, stop_on_signals, warn};
pub(super) use plan::{PlannedWork, Tasks};

const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Number of files that are open for a running process: its errors, its log twice, and its result.
pub(super) const FILES_PER_PROCESS: u64 = 4;

/// What the domains of the configs know.
pub(super) const KNOWLEDGE: Knowledge<'static> = Knowledge {
    simulated: &|config| {
        let domain = domains::find(config)?;
        Ok((domain.scenario()?, domain.rough_costs()))
    },
    controller: &|config, name| {
        let domain = domains::find(config)?;
        domain.check_baseline(name)?;
        let controller_file_crc32 = controller_file(&*domain, name)?;
        // A plan needs no SUMO.
        let sumo_version = domains::sumo(config).ok().flatten().map(|sumo| sumo.name.clone());
        Ok(MeasuredWith { controller_file_crc32, sumo_version })
    },
};

pub(super) fn experiment(args: &cli::ExperimentArgs) -> Result<()> {
    let name = args.file.file_stem().unwrap_or_default();
    let folder = args.out.clone().unwrap_or_else(|| Path::new("results").join(name).join("runs"));
    let cores = args.cores.unwrap_or_else(machine_cores);
    allow_open_files(cores, FILES_PER_PROCESS, "--cores").map_err(Error::Usage)?;
    let experiment = Experiment::read(&args.file, &KNOWLEDGE).map_err(Error::Usage)?;
    if args.dry_run {
        let tasks = Tasks::look(&experiment, &folder, cores, args.accept_other_build).map_err(Error::Usage)?;
        return answer(tasks.table()).map_err(Error::Run);
    }
    check_not_a_run("--out", &folder).map_err(Error::Usage)?;
    let directory = held(&folder).map_err(Error::Usage)?;
    // Before anything is read: a run that is being written has files that do not belong together.
    check_nobody_trains(&experiment, &folder).map_err(Error::Usage)?;
    let tasks = Tasks::look(&experiment, &folder, cores, args.accept_other_build).map_err(Error::Usage)?;
    if !args.accept_other_build {
        check_builds(&experiment, &folder).map_err(Error::Usage)?;
    }
    write_plan(&experiment, &args.file, &directory).map_err(Error::Usage)?;
    let finished = tasks.finished();
    let again = format!("{} experiment {} --out {}", program(), quoted(&args.file), quoted(&folder));
    let outcome = Batch::begin(tasks.unfinished(), directory, cores, None, &again).and_then(Batch::carry_out);
    let outcome = outcome.map_err(Error::Run)?;
    let made = outcome.tasks;
    outcome.judged(&folder.join(LOGS), &again)?;
    let report = folder.with_file_name("report");
    answer(format_args!(
        "{made} done now, {finished} done earlier; make the report with:\n  {} report {} --out {}",
        program(),
        quoted(&folder),
        quoted(&report)
    ))
    .map_err(Error::Run)
}

/// Makes the folder of the runs, if there is none, and locks it.
pub(super) fn held(folder: &Path) -> anyhow::Result<Directory> {
    for folder in [folder.to_owned(), folder.join(LOGS), folder.join(BASELINES)] {
        fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    Directory::lock(folder).map_err(|error| match error.is::<Busy>() {
        true => error.context(format!("{}: another experiment is running here", folder.display())),
        false => error,
    })
}

/// Adds the plan of an experiment to that of its folder, which this process has locked. `file`: that of the experiment.
pub(super) fn write_plan(experiment: &Experiment, file: &Path, folder: &Directory) -> anyhow::Result<()> {
    let plan = ExperimentPlan {
        runs: experiment.runs.iter().map(|run| run.name.clone()).collect(),
        baselines: experiment.baselines.iter().map(|baseline| baseline.name.clone()).collect(),
    };
    let failed = || format!("{}: its plan cannot be read; move {PLAN} away to begin it again", folder.path().display());
    let mut plans = FolderPlan::read(folder.path()).with_context(failed)?.unwrap_or_default();
    plans.put(&file.file_name().unwrap_or_default().to_string_lossy(), plan);
    folder.write(PLAN, &serde_json::to_vec_pretty(&plans).expect("names are JSON"))
}

pub(super) fn check_nobody_trains(experiment: &Experiment, folder: &Path) -> anyhow::Result<()> {
    for run in &experiment.runs {
        let dir = directory(folder, run);
        // The run of an experiment that was just killed ends within a moment.
        let free = !Directory::is_locked(&dir) || Directory::lock(&dir).is_ok();
        ensure!(free, Busy(dir));
    }
    Ok(())
}

/// Checks that no run that would be resumed was written by another build.
pub(super) fn check_builds(experiment: &Experiment, folder: &Path) -> anyhow::Result<()> {
    for run in &experiment.runs {
        if matches!(stage(folder, run)?, Stage::Begun { .. } | Stage::Running { .. }) {
            other_build(PROGRAM, &directory(folder, run), &run.config, false)?;
        }
    }
    Ok(())
}

pub(super) struct Outcome {
    pub(super) tasks: usize,
    failed: Vec<String>,
    interrupted: bool,
    /// Number of tasks that did not begin, because the time was used up.
    pub(super) left: usize,
}

impl Outcome {
    /// Returns an error unless all tasks are done. `again`: the command that tries or resumes the rest.
    pub(super) fn judged(self, logs: &Path, again: &str) -> Result<()> {
        let Outcome { tasks, failed, interrupted, .. } = self;
        let message =
            format!("{} of {tasks} failed: {}; their logs are in {}", failed.len(), failed.join(", "), logs.display());
        match (interrupted, failed.len()) {
            (true, 0) => Err(Error::Interrupted(format!("stopped; resume with: {again}"))),
            (true, _) => Err(Error::Interrupted(format!("stopped; {message}; resume with: {again}"))),
            (false, 0) => Ok(()),
            (false, failed) => {
                let others = if failed < tasks { "; the others are done" } else { "" };
                Err(Error::Run(anyhow!("{message}{others}; to try these again: {again}")))
            }
        }
    }
}

pub(super) struct Batch {
    /// Folder of the runs, which this process has locked.
    folder: Directory,
    waiting: Vec<PlannedWork>,
    working: Vec<(PlannedWork, RunProcess)>,
    cores: Cores,
    display: Display,
    said: (Sender<Said>, Receiver<Said>),
    stop: Arc<AtomicBool>,
    /// Time from which on no task begins but those that follow one that has ended.
    until: Option<Instant>,
    outcome: Outcome,
}

impl Batch {
    /// Begins the work. `waiting`: tasks that are not done. `until`: when to stop beginning tasks. `again`: the command that
    /// resumes the rest.
    pub(super) fn begin(
        mut waiting: Vec<PlannedWork>,
        folder: Directory,
        cores: usize,
        until: Option<Instant>,
        again: &str,
    ) -> anyhow::Result<Batch> {
        let last_words = format!("stopped; resume with: {again}");
        let stop = stop_on_signals(move |wish| match wish {
            Wish::Stop => (), // `carry_out` prints it
            Wish::StopNow => warn(&last_words),
        })?;
        let all = || waiting.iter().flat_map(PlannedWork::with_following);
        let mut outcome = Outcome { tasks: all().count(), failed: Vec::new(), interrupted: false, left: 0 };
        let mut display = Display::new(all().map(PlannedWork::planned).collect());
        for (task, why) in waiting.iter().filter_map(|task| Some((task, task.obstacle()?))) {
            log_obstacle(&task.name, why, &folder)?;
            display.ended(&task.name, Some(why));
            outcome.failed.push(task.name.clone());
            outcome.tasks -= task.then.len();
        }
        waiting.retain(|task| task.obstacle().is_none());
        // The next task is taken from the end.
        waiting.reverse();
        Ok(Batch {
            folder,
            waiting,
            working: Vec::new(),
            cores: Cores::new(cores),
            display,
            said: channel(),
            stop,
            until,
            outcome,
        })
    }

    pub(super) fn carry_out(mut self) -> anyhow::Result<Outcome> {
        let mut looked = Instant::now();
        loop {
            if self.stop.load(Ordering::Relaxed) && !self.outcome.interrupted {
                self.outcome.interrupted = true;
                self.waiting.clear();
                self.display.say("stopping each run at its next checkpoint; press Ctrl-C again, two seconds later or more, to stop now");
                self.working.iter().for_each(|(_, child)| child.ask_to_stop());
            }
            if self.until.is_some_and(|until| Instant::now() >= until) {
                self.until = None;
                self.leave_the_rest();
            }
            while let Some(task) = self.waiting.pop_if(|task| self.cores.take(task.width)) {
                self.start(task);
            }
            if self.working.is_empty() {
                self.display.finish();
                return Ok(self.outcome);
            }
            if let Ok(said) = self.said.1.recv_timeout(LOOK_EVERY.saturating_sub(looked.elapsed())) {
                self.display.heard(&said.task, &said.line);
            }
            // Also while processes print all the time.
            if looked.elapsed() >= LOOK_EVERY {
                self.display.tick();
                self.look_who_ended();
                looked = Instant::now();
            }
        }
    }

    /// Forgets the tasks that have not begun. Those that are running go on, and what follows them, too.
    fn leave_the_rest(&mut self) {
        let left: usize =
            self.waiting.iter().filter(|task| !task.follows).map(|task| task.with_following().count()).sum();
        self.waiting.retain(|task| task.follows);
        self.outcome.left = left;
        self.outcome.tasks -= left;
        self.display.say(&format!("the time is used up; {} left for another call", counted(left, "task")));
    }

    /// Starts a task. If it cannot be started, it has failed, and the others go on.
    fn start(&mut self, task: PlannedWork) {
        match RunProcess::start(&task, &self.folder, self.said.0.clone()) {
            Ok(child) => {
                self.display.began(&task.name);
                self.working.push((task, child));
            }
            Err(error) => self.ended(&task, Err(format!("error: {error:#}"))),
        }
    }

    fn look_who_ended(&mut self) {
        let mut still = Vec::new();
        for (mut task, mut child) in std::mem::take(&mut self.working) {
            match child.ended().unwrap_or_else(|error| Some(Err(format!("error: {error:#}")))) {
                Some(ended) => {
                    if ended.is_ok() && !self.outcome.interrupted {
                        let following = std::mem::take(&mut task.then).into_iter().rev();
                        self.waiting.extend(following.map(|task| PlannedWork { follows: true, ..task }));
                    }
                    self.ended(&task, ended);
                }
                None => still.push((task, child)),
            }
        }
        self.working = still;
    }

    fn ended(&mut self, task: &PlannedWork, ended: std::result::Result<(), String>) {
        self.cores.give_back(task.width);
        if ended.is_err() {
            self.outcome.tasks -= task.then.len();
        }
        if ended.is_err() && !self.outcome.interrupted {
            self.outcome.failed.push(task.name.clone());
        }
        // Its last lines were sent before its end was seen.
        self.said.1.try_iter().for_each(|said| self.display.heard(&said.task, &said.line));
        self.display.ended(&task.name, ended.err().as_deref());
    }
}
