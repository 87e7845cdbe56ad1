//! The options with which SUMO is loaded.

use std::path::Path;

use anyhow::Result;

use crate::traffic::network::files::for_sumo;

/// A step is a second.
pub const STEP_LENGTH_S: &str = "1";
/// Time after which a waiting car teleports: never.
pub const TIME_TO_TELEPORT_S: &str = "-1";

/// Returns the options that GS (global simulator) and LS (local simulator) have in common.
pub fn common(net: &Path, routes: &Path, seed: u32) -> Result<Vec<String>> {
    let options = [
        ["--net-file", &for_sumo(net)?],
        ["--route-files", &for_sumo(routes)?],
        ["--seed", &seed.to_string()],
        ["--step-length", STEP_LENGTH_S],
        ["--time-to-teleport", TIME_TO_TELEPORT_S],
    ];
    Ok(options.as_flattened().iter().map(|&text| text.to_owned()).collect())
}
