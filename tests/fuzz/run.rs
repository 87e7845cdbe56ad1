//! A small trained run of the warehouse: the seeds of checkpoints, networks and resumes. Only this file opens
//! checkpoints.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::Result;
use dials_core::outside::Directory;
use dials_session::domains::DomainConfig;
use dials_session::records::checkpoint::owner::Owner;
use dials_session::records::checkpoint::{self, Checkpoint};
use dials_warehouse::Warehouse;

use super::program;

/// Two periods of a few steps, small networks, and every file that a run can have.
const CONFIG: &str = "total_steps = 64
[warehouse]
agents_per_side = 2
horizon = 8
[local_simulators]
copies = 2
stagger = true
[policy]
recurrent = 3
hidden = [4]
[ppo]
rollout_steps = 8
memory = 32
minibatch = 16
epochs = 1
[aip]
hidden = [4]
retrain_every_steps = 32
dataset_steps = 24
batch = 4
epochs = 1
[evaluation]
every_steps = 32
episodes = 2
final_episodes = 2
aip_loss_episodes = 1
";

/// Variable with the folder of the runs, for child processes.
pub const RUNS: &str = "FUZZ_RUNS";

/// Makes the runs once per test process and returns their folder: `whole`, the run; `half`, the same run after its
/// first period; `other`, the same with another seed.
pub fn make() -> &'static Path {
    static RUNS: OnceLock<tempfile::TempDir> = OnceLock::new();
    let made = || {
        let folder = tempfile::tempdir().expect("a temporary folder");
        fs::write(folder.path().join("small.toml"), CONFIG).expect("a new file");
        for (name, more) in [("whole", &[][..]), ("half", &[]), ("other", &["--seed", "2"])] {
            let arguments = ["train", "small.toml", "--out", name, "--workers", "0"];
            let outcome = program::run_in(folder.path(), &[&arguments, more].concat());
            assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        }
        let mut checkpoints = checkpoints(&folder.path().join("half"));
        checkpoints.drain(..1);
        checkpoints.iter().for_each(|later| fs::remove_file(later).expect("a checkpoint"));
        folder
    };
    RUNS.get_or_init(made).path()
}

/// Returns the folder of one of the runs, in a child process.
pub fn dir(name: &str) -> PathBuf {
    PathBuf::from(std::env::var_os(RUNS).expect("the driver names it")).join(name)
}

/// Returns the checkpoints of a run, oldest first.
pub fn checkpoints(run: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(run.join("checkpoints")).expect("the run has checkpoints");
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    paths.sort();
    paths
}

/// Returns the bytes of the newest checkpoint of a run, and its name.
pub fn newest_checkpoint(run: &Path) -> (String, Vec<u8>) {
    let path = checkpoints(run).pop().expect("the run has checkpoints");
    let name = path.file_name().and_then(|name| name.to_str()).expect("a name of ours");
    (name.to_owned(), fs::read(&path).expect("a readable file"))
}

/// Reads the newest checkpoint in a folder as one of these runs.
pub fn read_checkpoint(folder: &Path) -> Result<Option<Checkpoint>> {
    let folder = Directory::open(folder)?;
    let newest = checkpoint::list(&folder)?.pop();
    newest.map(|name| Checkpoint::read(&folder, &name, owner())).transpose()
}

/// Writes a checkpoint as one of these runs would.
pub fn write_checkpoint(folder: &Path, Checkpoint { agents, progress }: Checkpoint) -> Result<()> {
    fs::create_dir_all(folder)?;
    checkpoint::write(&Directory::open(folder)?, owner(), &agents, progress)
}

/// Returns the run `whole` as the owner of checkpoints.
fn owner() -> &'static Owner {
    static OWNER: OnceLock<Owner> = OnceLock::new();
    OWNER.get_or_init(|| {
        let config = dials_session::config::load(&dir("whole").join("config.toml"), &[]).expect("the config of a run");
        let Some(DomainConfig::Warehouse(table)) = &config.domain else { panic!("the run is of the warehouse") };
        Owner::of(&config, &Warehouse::new(table)).expect("the warehouse has a scenario")
    })
}
