//! The tasks of an experiment, with their estimated time and memory.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::Result;

use dials_core::base::{TERMINAL_COLUMNS, counted, for_terminal};
use dials_learn::config::Simulator;
use dials_report::words::duration;
use dials_session::config::RunConfig;
use dials_session::experiment::estimate::{Estimate, estimate, estimate_controller};
use dials_session::experiment::file::{Experiment, PlannedBaseline, PlannedRun};
use dials_session::experiment::progress::{Stage, directory, stage, stage_of_baseline};
use dials_session::experiment::schedule::{Job, Total, total, width};
use dials_session::records::find::{baseline_file, find};
use dials_session::records::run_record::RunRecord;
use dials_session::terminal::experiment::Planned;

/// One process of the experiment.
#[derive(Clone, Debug)]
pub(in crate::run) struct PlannedWork {
    pub name: String,
    pub arguments: Vec<OsString>,
    /// File for its standard output, if that is its result.
    pub result: Option<PathBuf>,
    /// Config to write before it begins, with its path.
    pub config: Option<(PathBuf, RunConfig)>,
    pub width: usize,
    /// Timesteps per agent of the whole run; 0 for a baseline.
    pub steps: u64,
    pub stage: Stage,
    /// Share that is done, from 0 to 1.
    pub share: f64,
    pub agents: usize,
    pub estimate: Estimate,
    /// What is measured on the result. It begins right after this task, if this one ends well.
    pub then: Vec<PlannedWork>,
    /// Whether it follows a task that has ended.
    pub follows: bool,
}

impl PlannedWork {
    /// Makes a task that prints its result into a file, on one core. `arguments`: of this program.
    pub(in crate::run) fn measurement(
        name: String,
        arguments: Vec<OsString>,
        result: PathBuf,
        estimate: Estimate,
    ) -> PlannedWork {
        PlannedWork {
            name,
            arguments,
            result: Some(result),
            config: None,
            width: 1,
            steps: 0,
            stage: Stage::New,
            share: 0.0,
            agents: 0,
            estimate,
            then: Vec::new(),
            follows: false,
        }
    }

    fn of_run(
        run: &PlannedRun,
        folder: &Path,
        width: usize,
        measured: &[RunRecord],
        accept_other_build: bool,
    ) -> Result<PlannedWork> {
        let stage = stage(folder, run)?;
        let dir = directory(folder, run);
        let mut arguments: Vec<OsString> = vec!["train".into()];
        match &stage {
            Stage::New | Stage::Outdated | Stage::Unreadable { .. } => {
                arguments.extend([run.config_path.clone().into(), "--out".into(), dir.into()]);
                run.settings.iter().for_each(|setting| arguments.extend(["--set".into(), setting.into()]));
            }
            Stage::Begun { .. } | Stage::Running { .. } | Stage::Finished => {
                arguments.extend(["--resume".into(), dir.into()]);
                arguments.extend(accept_other_build.then(|| "--accept-other-build".into()));
            }
        }
        arguments.extend(["--workers".into(), width.to_string().into()]);
        Ok(PlannedWork {
            name: run.name.to_string(),
            arguments,
            result: None,
            config: None,
            width,
            steps: run.config.learning.last_step(),
            share: stage.share(run),
            stage,
            agents: run.agents(),
            estimate: estimate(run, width, measured),
            then: Vec::new(),
            follows: false,
        })
    }

    fn of_baseline(baseline: &PlannedBaseline, folder: &Path) -> Result<PlannedWork> {
        let result = baseline_file(folder, &baseline.name);
        let stage = stage_of_baseline(folder, baseline)?;
        let config = result.with_extension("toml");
        let mut arguments: Vec<OsString> = vec!["baseline".into(), config.clone().into()];
        arguments.extend(
            ["--controller", &baseline.controller, "--json", "--without-lights", "--episodes"].map(OsString::from),
        );
        arguments.push(baseline.episodes.to_string().into());
        Ok(PlannedWork {
            config: Some((config, baseline.config.clone())),
            share: if stage == Stage::Finished { 1.0 } else { 0.0 },
            stage,
            ..PlannedWork::measurement(baseline.name.to_string(), arguments, result, estimate_controller(baseline))
        })
    }

    pub(super) fn planned(&self) -> Planned {
        let PlannedWork { name, estimate, width, share, steps, .. } = self;
        Planned { name: name.clone(), seconds: estimate.seconds, width: *width, share: *share, steps: *steps }
    }

    /// Returns this task and those that follow it.
    pub(super) fn with_following(&self) -> impl Iterator<Item = &PlannedWork> {
        [self].into_iter().chain(&self.then)
    }

    /// Returns why the task cannot begin: its run is damaged.
    pub(super) fn obstacle(&self) -> Option<&str> {
        match &self.stage {
            Stage::Unreadable { why } => Some(why),
            _ => None,
        }
    }

    fn job(&self) -> Job {
        let Estimate { seconds, memory_mb, .. } = self.estimate;
        Job { width: self.width, seconds: seconds * (1.0 - self.share), memory_mb }
    }
}

pub(in crate::run) struct Tasks {
    tasks: Vec<PlannedWork>,
    cores: usize,
}

impl Tasks {
    /// Looks which tasks are done. `accept_other_build`: whether to resume runs that another build wrote.
    pub(in crate::run) fn look(
        experiment: &Experiment,
        folder: &Path,
        cores: usize,
        accept_other_build: bool,
    ) -> Result<Tasks> {
        // Without runs, estimates are only worse.
        let measured = find(&[folder.to_owned()]).map_or(Vec::new(), |found| found.runs);
        let baselines = experiment.baselines.iter().map(|baseline| PlannedWork::of_baseline(baseline, folder));
        let mut tasks = baselines.collect::<Result<Vec<PlannedWork>>>()?;
        for run in &experiment.runs {
            let gs = run.config.learning.simulator == Simulator::Global;
            let width = width(run.agents(), gs, experiment.all_cores_from_agents, cores);
            tasks.push(PlannedWork::of_run(run, folder, width, &measured, accept_other_build)?);
        }
        Ok(Tasks { tasks, cores })
    }

    pub(in crate::run) fn of(tasks: Vec<PlannedWork>, cores: usize) -> Tasks {
        Tasks { tasks, cores }
    }

    pub(in crate::run) fn all(self) -> Vec<PlannedWork> {
        self.tasks
    }

    pub(in crate::run) fn finished(&self) -> usize {
        self.tasks.iter().filter(|task| task.stage == Stage::Finished).count()
    }

    pub(super) fn unfinished(self) -> Vec<PlannedWork> {
        self.tasks.into_iter().filter(|task| task.stage != Stage::Finished).collect()
    }

    pub(in crate::run) fn table(&self) -> String {
        let begins = |task: &&PlannedWork| task.stage != Stage::Finished && task.obstacle().is_none();
        let to_do: Vec<&PlannedWork> = self.tasks.iter().filter(begins).collect();
        let jobs: Vec<Job> = to_do.iter().map(|task| task.job()).collect();
        let Total { seconds, memory_mb } = total(&jobs, self.cores);
        let mut lines = rows(&self.tasks);
        lines.push(String::new());
        let (to_begin, finished, time) = (to_do.len(), self.finished(), duration(seconds));
        let cores = counted(self.cores, "core");
        lines.push(for_terminal(&format!(
            "{to_begin} to do, {finished} finished; about {time} on {cores}, up to {memory_mb:.0} MiB at a time"
        )));
        let guessed = to_do.iter().filter(|task| task.steps > 0 && task.estimate.measured_runs == 0).count();
        if guessed > 0 {
            let estimates = "of the estimates are from another machine; they improve with the first runs";
            lines.push(format!("{guessed} {estimates}"));
        }
        let with_obstacles = self.tasks.iter().filter_map(|task| Some((task, task.obstacle()?)));
        lines.extend(with_obstacles.map(|(task, why)| format!("{}: {why}", task.name)));
        lines.join("\n")
    }
}

/// Returns the table of all tasks. It fits a terminal: a name that is too long has a line of its own.
fn rows(tasks: &[PlannedWork]) -> Vec<String> {
    let head = ["run", "stage", "agents", "cores", "time left", "memory"].map(str::to_owned);
    let cells: Vec<[String; 6]> = [head].into_iter().chain(tasks.iter().map(cells)).collect();
    let width = |column: usize| cells.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; 6] = std::array::from_fn(width);
    let [widest, stage, agents, cores, time, memory] = widths;
    let gaps = 2 * (widths.len() - 1);
    let name = widest.min(TERMINAL_COLUMNS.saturating_sub(widths[1..].iter().sum::<usize>() + gaps));
    let row = |[run, of_stage, of_agents, of_cores, left, needed]: &[String; 6]| {
        let (own_line, begins) = match run.chars().count() <= name {
            true => (String::new(), run.as_str()),
            false => (format!("{run}\n"), ""),
        };
        format!(
            "{own_line}{begins:<name$}  {of_stage:<stage$}  {of_agents:>agents$}  {of_cores:>cores$}  {left:>time$}  \
             {needed:>memory$}"
        )
    };
    cells.iter().map(row).collect()
}

/// Returns the cells of a task: run, stage, agents, cores, time left and memory.
fn cells(task: &PlannedWork) -> [String; 6] {
    let Job { seconds, memory_mb, .. } = task.job();
    let none = || "-".to_owned();
    let agents = if task.agents > 0 { task.agents.to_string() } else { none() };
    let [time, memory] = match task.stage {
        Stage::Finished | Stage::Unreadable { .. } => [none(), none()],
        _ => [duration(seconds), format!("{memory_mb:.0} MiB")],
    };
    [task.name.clone(), task.stage.name().to_owned(), agents, task.width.to_string(), time, memory]
}
