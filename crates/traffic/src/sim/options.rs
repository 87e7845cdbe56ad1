//! The options with which SUMO is loaded.

use crate::network::memory_file::MemoryFile;

/// A step is a second.
pub const STEP_LENGTH_S: &str = "1";
/// Time after which a waiting car teleports: never.
pub const TIME_TO_TELEPORT_S: &str = "-1";

/// Returns the options that GS (global simulator) and LS (local simulator) have in common.
pub fn common(net: &MemoryFile, routes: &MemoryFile, seed: u32) -> Vec<String> {
    let options = [
        ["--net-file", &net.path()],
        ["--route-files", &routes.path()],
        ["--seed", &seed.to_string()],
        ["--step-length", STEP_LENGTH_S],
        ["--time-to-teleport", TIME_TO_TELEPORT_S],
    ];
    options.as_flattened().iter().map(|&text| text.to_owned()).collect()
}
