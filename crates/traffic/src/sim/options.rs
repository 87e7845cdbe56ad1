//! The options with which SUMO is loaded.

use crate::network::memory_file::MemoryFile;

/// Options of time that GS and LS of a grid have, without `--`: a step is a second, and no car that waits teleports.
pub(crate) const TIME: [(&str, &str); 2] = [("step-length", "1"), NO_TELEPORTS];
pub(crate) const NO_TELEPORTS: (&str, &str) = ("time-to-teleport", "-1");

/// SUMO's seed in an LS. It changes nothing: on a grid nothing is random, and on a scenario each lane has its own seed.
pub(crate) const LOCAL_SEED: u32 = 0;

pub(crate) fn common(net: &MemoryFile, routes: &MemoryFile, step_length: &str) -> Vec<String> {
    let files = [("net-file", net.path()), ("route-files", routes.path()), ("seed", LOCAL_SEED.to_string())];
    let time = [("step-length", step_length), NO_TELEPORTS].map(|(name, value)| (name, value.to_owned()));
    let all = files.into_iter().chain(time);
    all.flat_map(|(name, value)| [format!("--{name}"), value]).collect()
}
