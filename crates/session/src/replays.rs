//! A recorded episode as a folder that SUMO plays.

use std::path::{Path, PathBuf};

use anyhow::Result;
use dials_traffic::sim::recording::Recording;
use dials_traffic::sim::replay;

use crate::places::{self, Existing};

/// Writes a recorded episode into a new folder, and returns the file that `sumo-gui -c` opens. Does not let SUMO play it,
/// so the caller may hold a simulation.
pub fn keep(recording: &Recording, folder: &Path) -> Result<PathBuf> {
    replay::check_place(folder)?;
    places::make(folder, Existing::Refuse, |staged| replay::write(recording, staged.path()))?;
    Ok(replay::config_in(folder))
}
