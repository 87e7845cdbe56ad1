//! Run directories: checkpoints, networks and CSV files of small trained runs. Only this file opens checkpoints.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::{Context, Result, bail, ensure};
use dials_core::base::{Dice, Ragged};
use dials_core::domain::Domain;
use dials_core::outside::Directory;
use dials_learn::algorithms::Tables;
use dials_learn::state::AgentsState;
use dials_learn::state::stream::AgentStream;
use dials_session::config::RunConfig;
use dials_session::domains::DomainConfig;
use dials_session::records::checkpoint::owner::Owner;
use dials_session::records::checkpoint::{self, Checkpoint, RunProgress};
use dials_session::records::files::{AIPS, CONFIG, GROWING, POLICIES};
use dials_session::records::networks::JointLayout;
use dials_warehouse::Warehouse;
use serde::{Deserialize, Serialize};
use tempfile::TempDir;

use super::place::{Place, copy, program};

/// Two periods of a few steps, small networks, and every file that a run can have.
const SMALL: &str = "total_steps = 64
warehouse = { agents_per_side = 2, horizon = 8 }
local_simulators = { copies = 2, stagger = true }
policy = { recurrent = 3, hidden = [4] }
ppo = { rollout_steps = 8, memory = 32, minibatch = 16, epochs = 1 }
aip = { hidden = [4], retrain_every_steps = 32, dataset_steps = 24, batch = 4, epochs = 1 }
evaluation = { every_steps = 32, episodes = 2, final_episodes = 2, aip_loss_episodes = 1 }
";
/// Largest number of parameters of a table of a crafted checkpoint.
const LARGEST: usize = 1 << 20;

/// Runs of the warehouse: `whole`; `half`, the same run after its first period; `other`, the same with another seed.
pub(crate) struct Runs {
    folder: TempDir,
    config: RunConfig,
    domain: Warehouse,
    owner: Owner,
}

impl Runs {
    pub(crate) fn make() -> Runs {
        let folder = tempfile::tempdir().expect("a temporary folder");
        fs::write(folder.path().join("small.toml"), SMALL).expect("a new file");
        for (name, seed) in [("whole", "1"), ("half", "1"), ("other", "2")] {
            let arguments = ["train", "small.toml", "--out", name, "--workers", "0", "--seed", seed];
            let outcome = program(folder.path(), &arguments);
            assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        }
        for later in &checkpoints(&folder.path().join("half"))[1..] {
            fs::remove_file(later).expect("a checkpoint");
        }
        let config =
            dials_session::config::load(&folder.path().join("whole").join(CONFIG), &[]).expect("the config of a run");
        let Some(DomainConfig::Warehouse(table)) = &config.domain else { panic!("the run is of the warehouse") };
        let domain = Warehouse::new(table);
        let owner = Owner::of(&config, &domain).expect("the warehouse has a scenario");
        Runs { folder, config, domain, owner }
    }

    fn dir(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn file(&self, name: &str, file: &str) -> Vec<u8> {
        fs::read(self.dir(name).join(file)).expect("a file of the run")
    }

    fn newest(&self, name: &str) -> PathBuf {
        checkpoints(&self.dir(name)).pop().expect("the run has checkpoints")
    }

    /// Reads the newest checkpoint in a folder as one of these runs.
    fn read(&self, folder: &Path) -> Result<Checkpoint> {
        let folder = Directory::open(folder)?;
        let newest = checkpoint::list(&folder)?.pop().expect("the checkpoint is seen");
        Checkpoint::read(&folder, &newest, &self.owner)
    }
}

/// Returns the checkpoints of a run, oldest first.
fn checkpoints(run: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(run.join("checkpoints")).expect("the run has checkpoints");
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    paths.sort();
    paths
}

pub(crate) fn checkpoint_seeds(place: &Place) -> Vec<Vec<u8>> {
    vec![fs::read(place.runs().newest("whole")).expect("a readable file")]
}

/// Checkpoints that are whole, but of another step or another run: parts of them may get into one.
pub(crate) fn strangers(place: &Place) -> Vec<Vec<u8>> {
    ["half", "other"].map(|name| fs::read(place.runs().newest(name)).expect("a readable file")).into()
}

/// A damaged checkpoint is refused, or it is the same state.
pub(crate) fn checkpoint(place: &Place, bytes: &[u8]) -> Result<()> {
    static STATE: OnceLock<Checkpoint> = OnceLock::new();
    let runs = place.runs();
    let state = STATE.get_or_init(|| runs.read(&runs.dir("whole/checkpoints")).expect("a whole checkpoint"));
    let folder = place.empty("checkpoints");
    fs::write(folder.join(runs.newest("whole").file_name().expect("a name of ours")), bytes).expect("a new file");
    let read = runs.read(&folder)?;
    let is_stranger = strangers(place).iter().any(|stranger| stranger == bytes);
    assert_eq!(read == *state, !is_stranger, "another state is read: {:?}", read.progress);
    Ok(())
}

pub(crate) fn policies_seeds(place: &Place) -> Vec<Vec<u8>> {
    ["whole", "other"].map(|run| place.runs().file(run, POLICIES)).into()
}

pub(crate) fn policies(place: &Place, bytes: &[u8]) -> Result<()> {
    let Runs { config, domain, .. } = place.runs();
    networks(place, bytes, &JointLayout::of_policies(domain.kinds(), &config.learning.policy))
}

pub(crate) fn aips_seeds(place: &Place) -> Vec<Vec<u8>> {
    ["whole", "other"].map(|run| place.runs().file(run, AIPS)).into()
}

pub(crate) fn aips(place: &Place, bytes: &[u8]) -> Result<()> {
    let Runs { config, domain, .. } = place.runs();
    networks(place, bytes, &JointLayout::of_aips(domain.kinds(), config.learning.predictor(), &config.learning.aip))
}

/// Accepted networks have finite parameters, one row for each agent.
fn networks(place: &Place, bytes: &[u8], layout: &JointLayout) -> Result<()> {
    let networks = layout.read(&place.file("networks.safetensors", bytes))?;
    assert_eq!(networks.len(), place.runs().domain.agents(), "one network for each agent");
    assert!(networks.as_slice().iter().all(|value| value.is_finite()), "a parameter is not a finite number");
    Ok(())
}

/// The first line of an input names a CSV file of a run, the rest is its content.
pub(crate) fn resume_seeds(place: &Place) -> Vec<Vec<u8>> {
    let dir = place.runs().dir("half");
    let there = GROWING.iter().filter(|name| dir.join(name).is_file());
    there.map(|name| [name.as_bytes(), b"\n", &place.runs().file("half", name)].concat()).collect()
}

/// A run that goes on from its first checkpoint gets the policies of the run that nobody disturbed.
pub(crate) fn resume(place: &Place, bytes: &[u8]) -> Result<()> {
    let line = bytes.iter().position(|&byte| byte == b'\n').unwrap_or(bytes.len());
    let Some(name) = GROWING.iter().find(|known| known.as_bytes() == &bytes[..line]) else { bail!("no such file") };
    let dir = place.empty("run");
    copy(&place.runs().dir("half"), &dir);
    place.file(&format!("run/{name}"), bytes.get(line + 1..).unwrap_or(&[]));
    go_on(place)?;
    let learned = fs::read(dir.join(POLICIES)).expect("a run that is done has policies");
    assert!(learned == place.runs().file("whole", POLICIES), "the resumed run learned something else");
    Ok(())
}

fn go_on(place: &Place) -> Result<()> {
    let outcome = place.program(&["train", "--resume", "run", "--workers", "0"]);
    ensure!(outcome.code == 0, outcome.stderr);
    Ok(())
}

/// The state of a checkpoint as text, which is mutated: all but the thousands of parameters, of which it has the widths.
#[derive(Serialize, Deserialize)]
struct State {
    progress: RunProgress,
    steps: u64,
    policies: Vec<usize>,
    learners: BTreeMap<String, Vec<usize>>,
    dice: BTreeMap<String, Vec<Vec<Dice>>>,
    counts: BTreeMap<String, u64>,
    aips: Vec<usize>,
    streams: Vec<AgentStream>,
}

pub(crate) fn crafted_seeds(place: &Place) -> Vec<Vec<u8>> {
    let runs = place.runs();
    let Checkpoint { agents, progress } = runs.read(&runs.dir("half/checkpoints")).expect("a whole checkpoint");
    let widths = |table: &Ragged<f32>| table.widths().collect();
    let state = State {
        progress,
        steps: agents.steps,
        policies: widths(&agents.policies),
        learners: agents.learners.numbers.iter().map(|(name, table)| (name.clone(), widths(table))).collect(),
        dice: agents.learners.dice,
        counts: agents.learners.counts,
        aips: widths(&agents.aips),
        streams: agents.streams,
    };
    vec![serde_json::to_vec_pretty(&state).expect("numbers can be written")]
}

/// The program refuses a checkpoint that somebody wrote, whole and with a right checksum, or goes on from it to the end.
pub(crate) fn crafted(place: &Place, bytes: &[u8]) -> Result<()> {
    let state: State = serde_json::from_slice(bytes)?;
    let runs = place.runs();
    let original = runs.read(&runs.dir("half/checkpoints"))?.agents;
    // The parameters of the original one, as often as they fit in.
    let table = |values: &Ragged<f32>, widths: &[usize]| {
        let sum = widths.iter().try_fold(0_usize, |sum, &width| sum.checked_add(width));
        let sum = sum.filter(|&sum| sum <= LARGEST).context("more parameters than are tried")?;
        let values = values.as_slice().iter().copied().cycle().take(sum).collect();
        Ragged::from_vec(values, widths.iter().copied()).context("widths without an agent")
    };
    let learners = state.learners.iter().map(|(name, widths)| {
        let values = original.learners.numbers.get(name).unwrap_or(&original.policies);
        Ok((name.clone(), table(values, widths)?))
    });
    let agents = AgentsState {
        steps: state.steps,
        policies: table(&original.policies, &state.policies)?,
        learners: Tables {
            numbers: learners.collect::<Result<_>>()?,
            dice: state.dice,
            counts: state.counts,
            bytes: Vec::new(),
        },
        aips: table(&original.aips, &state.aips)?,
        streams: state.streams,
        outside_aips: Vec::new(),
    };
    copy(&runs.dir("half"), &place.empty("run"));
    let folder = place.empty("run/checkpoints");
    checkpoint::write(&Directory::open(&folder)?, &runs.owner, &agents, state.progress)?;
    go_on(place)
}
