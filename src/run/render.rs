//! `--render`: draws an episode, one picture per step.

use std::path::Path;

use anyhow::{Context, Result, bail};

use super::places::{self, Existing};
use crate::base::Seed;
use crate::domain::{Controller, GlobalSimulator};
use crate::evaluation::{episode_seed, play_watched};
use crate::film::scenes;

/// Plays the first evaluation episode of the seed `run` and draws it into the directory `dir`, which is made anew.
///
/// The files are `step_NNN.svg` for every step, and `episode.gif`.
pub fn render(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    run: Seed,
    dir: &Path,
    existing: Existing,
) -> Result<()> {
    if simulator.scene().is_none() {
        bail!("--render: this domain draws no pictures; try --plot, or `replay` for sumo-gui");
    }
    let mut drawn = Vec::new();
    play_watched(simulator, controller, episode_seed(run, 0), &mut |simulator| {
        drawn.push(simulator.scene().context("the domain drew no picture of a step")?);
        Ok(())
    })?;
    places::make(dir, existing, |dir| scenes::write(&drawn, dir))
        .with_context(|| format!("{}: cannot be written", dir.display()))
        .map(drop)
}
