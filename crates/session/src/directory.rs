//! Makes and opens run directories.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Error, Result, anyhow, bail, ensure};

use super::build::{self, Program};
use super::domains;
use super::outputs::check_not_of_a_run;
use super::parent::END_WITH;
use super::places::{self, Existing};
use crate::config::RunConfig;
use crate::records::checkpoint::newest_step;
use crate::records::checkpoint::owner::Owner;
use crate::records::files;
use crate::records::networks::JointLayout;
use crate::records::run_json::{Kept, RunJson, Word};
use crate::terminal::{note, program};
use dials_core::base::{AgentId, counted};
use dials_core::domain::Domain;
use dials_core::outside::{Directory, Whereabouts, quoted};
use dials_learn::policy::{JointPolicy, JointPolicyController, Selection};
use dials_learn::predictors::TrainablePredictor;
use dials_learn::worker::block::initial_aips;

/// Makes the directory of a new run, with its config, networks and circumstances, and returns it, locked.
pub fn create(path: &Path, existing: Existing, config: &RunConfig, program: Program) -> Result<Directory> {
    // The run loads its networks from there later.
    domains::find(config)?.check_place(&places::place(path, existing)?.join(files::NETWORKS))?;
    check_not_of_a_run("--out", path)?;
    places::make(path, existing, |dir| describe(dir, config, program))
}

/// Writes the config, the networks and `run.json`.
fn describe(dir: &Directory, config: &RunConfig, program: Program) -> Result<()> {
    let domain = domains::find(config)?;
    let kept = domains::keep_files(config, &*domain, dir.path())?;
    dir.put(files::CONFIG, crate::config::to_toml(&kept)?.as_bytes())?;
    let run = RunJson {
        command: command_line(),
        kept: Kept::of(dir.path(), &kept)?,
        python: domains::python_functions(config)?,
        versions: build::here(program, config)?,
        ..RunJson::new(domain.scenario()?, domain.names(), config.learning.seed)
    };
    run.write(dir)
}

/// Returns the words of the command line, without the hidden flag that ends a run together with its experiment.
fn command_line() -> Vec<Word> {
    let mut words = std::env::args_os();
    let mut kept = Vec::new();
    while let Some(word) = words.next() {
        if word == END_WITH {
            words.next();
        } else {
            kept.push(Word::from(&*word));
        }
    }
    kept
}

pub struct TrainedRun {
    pub config: RunConfig,
    pub domain: Arc<dyn Domain>,
    pub policies: JointPolicy,
    /// Timesteps per agent of these policies, if their file says so.
    pub steps: Option<u64>,
    /// The same, if somebody is still training the run.
    pub still_trained_at: Option<u64>,
}

impl TrainedRun {
    /// Says of which step the policies are, if somebody is still training the run.
    pub fn note_still_trained(&self, path: &Path) {
        if let Some(steps) = self.still_trained_at {
            note(format_args!("{}: is still being trained; its policies are those of step {steps}", path.display()));
        }
    }

    pub fn controller(&self, selection: Selection) -> JointPolicyController {
        JointPolicyController::new(self.domain.kinds(), &self.config.learning, &self.policies, selection)
    }
}

/// Reads the config of a run directory and opens its domain by `open`: [`domains::open`], [`domains::open_untried`] or
/// [`domains::find`].
pub fn open_config(
    path: &Path,
    open: fn(&RunConfig) -> Result<Arc<dyn Domain>>,
) -> Result<(RunConfig, Arc<dyn Domain>)> {
    check(path)?;
    let config = crate::config::load(&path.join(files::CONFIG), &[])?;
    let domain = open(&config)?;
    Ok((config, domain))
}

/// Like [`open_config`]. Networks or keys of the domain that were changed after the run began are an error.
pub fn open_unchanged(
    path: &Path,
    open: fn(&RunConfig) -> Result<Arc<dyn Domain>>,
) -> Result<(RunConfig, Arc<dyn Domain>)> {
    let (config, domain) = open_config(path, open)?;
    Owner::of(&config, &*domain)?.check_unchanged(path)?;
    Ok((config, domain))
}

pub fn open(path: &Path) -> Result<TrainedRun> {
    open_with(path, domains::open)
}

/// Reads a run directory like [`open`]. `open`: how its domain is opened, as for [`open_config`].
pub fn open_with(path: &Path, open: fn(&RunConfig) -> Result<Arc<dyn Domain>>) -> Result<TrainedRun> {
    check(path)?;
    let directory = Directory::open(path)?;
    let saved = path.join(files::POLICIES);
    ensure!(
        saved.is_file() || has_checkpoint(path),
        "{}: has no policies yet; they are written at the end of the first period",
        path.display()
    );
    let (config, domain) = open_unchanged(path, open)?;
    ensure!(
        !config.learning.learns_outside(),
        "{}: its policies are in Python, where dials_traffic.dials(...) trained them; its returns.csv has their evaluations",
        path.display()
    );
    let layout = JointLayout::of_policies(domain.kinds(), &config.learning.policy);
    let (policies, steps) = layout.read_with_steps(&saved).map_err(|error| with_way_out(error, path))?;
    ensure!(
        directory.whereabouts() == Whereabouts::InPlace,
        "{}: was moved while it was read; try again",
        path.display()
    );
    let still_trained_at = steps.filter(|_| Directory::is_locked(path));
    Ok(TrainedRun { config, domain, policies, steps, still_trained_at })
}

/// Reads the AIPs of `agents`, of one kind, from a run with this config. `domain`: one with the same agents.
pub fn read_aips(
    path: &Path,
    config: &RunConfig,
    domain: &dyn Domain,
    agents: &[AgentId],
) -> Result<Box<dyn TrainablePredictor>> {
    let choice = config.learning.predictor_in_use().with_context(|| {
        format!("{}: was trained on the GS and has no AIPs, so its local simulators cannot be played", path.display())
    })?;
    ensure!(
        !config.learning.predicts_outside(),
        "{}: its influence predictor is in Python; local simulators of this run need that object: \
         dials_traffic.vector_env(..., predictor=...)",
        path.display()
    );
    let mut aips = initial_aips(domain, &config.learning, agents);
    // A predictor that is never trained is never written.
    if choice.kind().learns() {
        let layout = JointLayout::of_aips(domain.kinds(), choice, &config.learning.aip);
        let of_all = layout.read(&path.join(files::AIPS)).map_err(|error| with_way_out(error, path))?;
        aips.load(&of_all.pick(agents.iter().map(|agent| agent.0)).into_rows());
    }
    Ok(aips)
}

/// Returns whether a run has a checkpoint, from which a resume makes its networks again.
fn has_checkpoint(run: &Path) -> bool {
    Directory::open(run).and_then(|run| newest_step(&run)).is_ok_and(|step| step.is_some())
}

/// Adds the way out, if there is one, to the error about a file of networks.
fn with_way_out(error: Error, run: &Path) -> Error {
    if !has_checkpoint(run) {
        return error;
    }
    let resume = format!("{} train --resume {}", program(), quoted(run));
    anyhow!("{error:#}; a resume makes the file again, from the newest checkpoint: {resume}")
}

pub fn check(path: &Path) -> Result<()> {
    if files::is_run_dir(path) {
        return Ok(());
    }
    let place = path.display();
    ensure!(path.exists(), "{place}: no such run directory; `dials-traffic train` makes one");
    let inside = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut inside: Vec<PathBuf> = inside.filter(|path| files::is_run_dir(path)).collect();
    inside.sort();
    if let Some(first) = inside.first() {
        let runs = counted(inside.len(), "run");
        bail!("{place}: not a run directory; it holds {runs}: name one, such as {}", first.display());
    }
    bail!("{place}: not a run directory: it has no {}; `dials-traffic train` makes one", files::CONFIG)
}
