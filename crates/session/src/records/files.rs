//! The names of the files of a run directory.

pub const CONFIG: &str = "config.toml";
pub const NETWORKS: &str = "networks";
pub const RUN: &str = "run.json";
pub const RETURNS: &str = "returns.csv";
pub(crate) const EPISODES: &str = "episodes.csv";
pub const IMITATION: &str = "imitation.csv";
pub const TRAINING: &str = "training.csv";
pub const AIP_LOSS: &str = "aip_loss.csv";
pub const AIP_DRIFT: &str = "aip_drift.csv";
pub const TIMING: &str = "timing.csv";
pub const MEMORY: &str = "memory.csv";
/// Name of the file for TensorBoard, which looks for this word in a name.
pub const EVENTS: &str = "events.out.tfevents";
pub const POLICIES: &str = "policies.safetensors";
pub const AIPS: &str = "aips.safetensors";
pub const CHECKPOINTS: &str = "checkpoints";
pub const PREPARED: &str = "local_simulators.bin";

/// Files that are replaced as a whole.
pub(crate) const WRITTEN: [&str; 5] = [CONFIG, RUN, POLICIES, AIPS, PREPARED];

/// Files that grow during the run.
pub const GROWING: [&str; 9] = [IMITATION, RETURNS, EPISODES, TRAINING, AIP_LOSS, AIP_DRIFT, TIMING, MEMORY, EVENTS];

/// Returns whether a run directory uses this name, or may use it later.
pub(crate) fn is_own(name: &str) -> bool {
    let worker = name.strip_prefix("worker_").and_then(|rest| rest.strip_suffix(".log"));
    let is_log = worker.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()));
    is_log || [NETWORKS, CHECKPOINTS].iter().chain(&WRITTEN).chain(&GROWING).any(|&own| own == name)
}

/// Returns whether a folder is a run directory: one with a config.
pub fn is_run_dir(path: &std::path::Path) -> bool {
    path.join(CONFIG).is_file()
}
