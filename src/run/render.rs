//! `--render`: draws an episode, one picture per step.

use std::path::Path;

use anyhow::{Context, Result, bail};

use crate::film::scenes;
use dials_core::base::Seed;
use dials_core::domain::{Controller, GlobalSimulator, Measures};
use dials_learn::evaluation::{episode_seed, play_watched};
use dials_session::places::{self, Existing};

/// Plays the first evaluation episode of the seed `run` and draws it into the directory `dir`, which is made anew.
///
/// The files are `step_NNN.svg` for every step, and `episode.gif`.
pub(super) fn render(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    run: Seed,
    dir: &Path,
    existing: Existing,
) -> Result<()> {
    if simulator.scene().is_none() {
        bail!("--render: this domain draws no pictures; try --plot, or `replay` for sumo-gui");
    }
    let (mut drawn, mut titles) = (Vec::new(), Vec::new());
    play_watched(simulator, controller, episode_seed(run, 0), &mut |simulator| {
        drawn.push(simulator.scene().context("the domain drew no picture of a step")?);
        titles.push(title(titles.len(), &simulator.measures()?));
        Ok(())
    })?;
    places::make(dir, existing, |dir| scenes::write(&drawn, &titles, dir))
        .with_context(|| format!("{}: cannot be written", dir.display()))
        .map(drop)
}

/// Returns the title of a step: its number, and what the agents have together in each figure.
fn title(step: usize, measures: &Measures) -> String {
    let figures = measures.per_agent.iter().map(|(name, values)| format!(", {name} {:.0}", values.iter().sum::<f64>()));
    format!("step {step}{}", figures.collect::<String>())
}
