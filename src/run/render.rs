//! `--render`: pictures of an episode.

use std::path::Path;

use anyhow::{Context, Result, bail};

use super::places::{self, Existing};
use crate::base::Seed;
use crate::domain::{Controller, GlobalSimulator};
use crate::evaluation::{episode_seed, play_watched};
use crate::film::scenes;

/// Plays the first evaluation episode of `run` and makes the directory `dir`: `step_NNN.svg` for every step and `episode.gif`.
pub fn render(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    run: Seed,
    dir: &Path,
) -> Result<()> {
    if simulator.scene().is_none() {
        bail!("--render: this domain draws no pictures; --plot may draw some, and `replay` write what sumo-gui plays");
    }
    let mut drawn = Vec::new();
    play_watched(simulator, controller, episode_seed(run, 0), &mut |simulator| {
        drawn.push(simulator.scene().context("a picture of every step")?);
        Ok(())
    })?;
    places::make(dir, Existing::Refuse, |dir| scenes::write(&drawn, dir))
        .with_context(|| format!("{}: cannot be written", dir.display()))
}
