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
use crate::records::joint_layout::JointLayout;
use crate::records::kept::Kept;
use crate::records::run_json::RunJson;
use crate::records::word::Word;
use crate::terminal::{note, program};
use dials_core::base::{AgentId, counted};
use dials_core::domain::Domain;
use dials_core::outside::{Directory, Whereabouts, quoted};
use dials_learn::influence::TrainablePredictor;
use dials_learn::policy::{JointPolicy, JointPolicyController, Selection};
use dials_learn::training::block::initial_aips;

/// Makes the directory of a new run and returns it, locked.
///
/// The directory is self-contained: it holds the config, the networks and the circumstances of the run.
pub fn create(path: &Path, existing: Existing, config: &RunConfig, program: Program) -> Result<Directory> {
    // The run loads its networks from there later.
    domains::check_place(config, &places::place(path, existing)?)?;
    check_not_of_a_run("--out", path)?;
    places::make(path, existing, |dir| describe(dir, config, program))
}

/// Writes the config, the networks and `run.json`.
fn describe(dir: &Directory, config: &RunConfig, program: Program) -> Result<()> {
    let domain = domains::find(config)?;
    let kept = domains::keep_files(config, &*domain, dir.path())?;
    dir.put(files::CONFIG, crate::config::to_toml(&kept)?.as_bytes())?;
    let versions = build::here(program, config.numerics.vector_width)?;
    let run = RunJson {
        command: command_line(),
        kept: Kept::of(dir.path(), &kept)?,
        versions,
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

/// A run with trained policies.
pub struct TrainedRun {
    pub config: RunConfig,
    pub domain: Arc<dyn Domain>,
    pub policies: JointPolicy,
    /// Timesteps per agent of these policies, if somebody is still training the run.
    pub still_trained_at: Option<u64>,
}

impl TrainedRun {
    /// Says of which step the policies are, if somebody is still training the run.
    pub fn note_still_trained(&self, path: &Path) {
        if let Some(steps) = self.still_trained_at {
            note(format_args!("{}: is still being trained; its policies are those of step {steps}", path.display()));
        }
    }
}

/// Reads the config of a run directory and opens its domain. `open`: [`domains::open`], or [`domains::open_tried`] if its
/// networks were tried already.
pub fn open_config(
    path: &Path,
    open: fn(&RunConfig) -> Result<Arc<dyn Domain>>,
) -> Result<(RunConfig, Arc<dyn Domain>)> {
    check(path)?;
    let config = crate::config::load(&path.join(files::CONFIG), &[])?;
    let domain = open(&config)?;
    Ok((config, domain))
}

/// Reads the config of a run directory and opens its domain, like [`open_config`]. It is an error if the networks or the
/// domain's keys are other ones than when the run began.
pub fn open_unchanged(
    path: &Path,
    open: fn(&RunConfig) -> Result<Arc<dyn Domain>>,
) -> Result<(RunConfig, Arc<dyn Domain>)> {
    let (config, domain) = open_config(path, open)?;
    Owner::of(&config, &*domain)?.check_unchanged(path)?;
    Ok((config, domain))
}

/// Reads a run directory: its config, domain and policies.
pub fn open(path: &Path) -> Result<TrainedRun> {
    open_with(path, domains::open)
}

/// Reads a run directory like [`open`]. `open`: how its domain is opened, as for [`open_config`].
pub fn open_with(path: &Path, open: fn(&RunConfig) -> Result<Arc<dyn Domain>>) -> Result<TrainedRun> {
    check(path)?;
    let directory = Directory::open(path)?;
    let (config, domain) = open_unchanged(path, open)?;
    let saved = path.join(files::POLICIES);
    ensure!(
        saved.is_file() || has_checkpoint(path),
        "{}: has no policies yet; they are written at the end of the first period",
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
    Ok(TrainedRun { config, domain, policies, still_trained_at })
}

/// Reads the approximate influence predictors (AIPs) of `agents`, which are of one kind, from a run directory.
///
/// `config`: that of the run; `domain`: one with the same agents.
pub fn read_aips(
    path: &Path,
    config: &RunConfig,
    domain: &dyn Domain,
    agents: &[AgentId],
) -> Result<Box<dyn TrainablePredictor>> {
    let choice = config.learning.predictor_in_use().with_context(|| {
        format!("{}: was trained on the GS and has no AIPs, so its local simulators cannot be played", path.display())
    })?;
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

/// Checks that there is a run directory.
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

impl TrainedRun {
    /// Returns the policies as a controller for the global simulator (GS).
    pub fn controller(&self, selection: Selection) -> JointPolicyController {
        JointPolicyController::new(self.domain.kinds(), &self.config.learning, &self.policies, selection)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    use crate::domains::DomainConfig;
    use dials_traffic::config::{TrafficConfig, TrafficTable};
    use dials_traffic::network::contents::Network;
    use dials_traffic::network::files::NetworkFiles;
    use dials_traffic::network::way_out::Role;

    const PROGRAM: Program = Program { version: "0", git_commit: "test", libtorch: "none" };

    /// A config that is loaded from `dir`, with the networks of this project.
    fn config_in(dir: &Path) -> RunConfig {
        let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../sumo_nets");
        let text = format!("[traffic]\nnetwork = '{0}/grid_2x2'\nlocal_network = '{0}/local'\n", nets.display());
        fs::write(dir.join("c.toml"), text).unwrap();
        crate::config::load(&dir.join("c.toml"), &[]).unwrap()
    }

    fn traffic_in(config: &mut RunConfig) -> &mut TrafficConfig {
        let Some(DomainConfig::Traffic(TrafficTable::Grid(table))) = &mut config.domain else {
            panic!("this config is of traffic")
        };
        table
    }

    fn networks_of(config: &RunConfig) -> [NetworkFiles; 2] {
        let traffic = traffic_in(&mut config.clone()).clone();
        [&traffic.network, &traffic.local_network].map(|network| NetworkFiles::of(network))
    }

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn an_existing_directory_is_refused_numbered_or_moved_aside() {
        let dir = tempfile::tempdir().unwrap();
        let (config, path) = (config_in(dir.path()), dir.path().join("a.b"));
        create(&path, Existing::Refuse, &config, PROGRAM).unwrap();
        fs::write(path.join("precious"), "x").unwrap();
        let error = create(&path, Existing::Refuse, &config, PROGRAM).unwrap_err().to_string();
        assert!(error.contains("exists already") && error.contains("--force"), "{error}");
        let numbered = |path: &Path| create(path, Existing::Number, &config, PROGRAM).unwrap().path().to_owned();
        assert_eq!(numbered(&path), dir.path().join("a.b-2"));
        assert_eq!(numbered(&path), dir.path().join("a.b-3"));
        assert_eq!(numbered(&dir.path().join("c")), dir.path().join("c"));
        create(&path, Existing::MoveAside, &config, PROGRAM).unwrap();
        assert!(!path.join("precious").exists());
        assert!(dir.path().join("a.b.old-1/precious").exists());
        assert_eq!(names(dir.path()), ["a.b", "a.b-2", "a.b-3", "a.b.old-1", "c", "c.toml"]);
    }

    #[test]
    fn an_error_changes_nothing_and_leaves_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        let (config, path) = (config_in(dir.path()), dir.path().join("run"));
        create(&path, Existing::Refuse, &config, PROGRAM).unwrap();
        fs::write(path.join("precious"), "x").unwrap();
        let mut lost = config.clone();
        traffic_in(&mut lost).network = dir.path().join("nowhere");
        for place in [path.clone(), dir.path().join("new/and/deep")] {
            let error = create(&place, Existing::MoveAside, &lost, PROGRAM).unwrap_err();
            assert!(error.to_string().contains("nowhere.net.xml: no such network"), "{error}");
            assert_eq!(names(dir.path()), ["c.toml", "run"]);
        }
        assert!(path.join("precious").exists());
    }

    #[test]
    fn a_run_may_take_the_place_of_the_one_that_its_networks_come_from() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run");
        create(&path, Existing::Refuse, &config_in(dir.path()), PROGRAM).unwrap();
        let kept = crate::config::load(&path.join(files::CONFIG), &[]).unwrap();
        create(&path, Existing::MoveAside, &kept, PROGRAM).unwrap();
        let again = crate::config::load(&path.join(files::CONFIG), &[]).unwrap();
        networks_of(&again).iter().for_each(|network| network.check().unwrap());
    }

    #[test]
    fn networks_of_one_name_from_two_folders_are_both_kept() {
        let dir = tempfile::tempdir().unwrap();
        let mut config = config_in(dir.path());
        let [global, local] = networks_of(&config);
        for (network, folder) in [(&global, "g"), (&local, "l")] {
            Network::read(network, Role::Global).unwrap().copy_to(&dir.path().join(folder), "same").unwrap();
        }
        let traffic = traffic_in(&mut config);
        traffic.network = dir.path().join("g/same");
        traffic.local_network = dir.path().join("l/same");
        let path = dir.path().join("run");
        create(&path, Existing::Refuse, &config, PROGRAM).unwrap();
        let kept = networks_of(&crate::config::load(&path.join(files::CONFIG), &[]).unwrap());
        for (kept, original) in kept.iter().zip([&global, &local]) {
            assert_eq!(fs::read(&kept.net).unwrap(), fs::read(&original.net).unwrap());
            assert_eq!(fs::read(&kept.routes).unwrap(), fs::read(&original.routes).unwrap());
        }
    }
}
