//! `--render`: pictures of an episode.

use std::fs::{self, File};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use super::places::{self, Existing};
use crate::base::Seed;
use crate::domain::{Colour, Controller, GlobalSimulator, Scene};
use crate::evaluation::{episode_seed, play_watched};

/// Pixels per unit of a scene.
const SCALE: usize = 16;
/// Hundredths of a second that the animation shows a step.
const STEP_TIME: u16 = 20;

/// Plays the first evaluation episode of `run` and makes the directory `dir`: `step_NNN.svg` for every step and `episode.gif`.
pub fn render(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    run: Seed,
    dir: &Path,
) -> Result<()> {
    if simulator.scene().is_none() {
        bail!(
            "--render: this domain draws no pictures; of traffic, --plot draws some and `replay` writes what sumo-gui plays"
        );
    }
    let mut scenes = Vec::new();
    play_watched(simulator, controller, episode_seed(run, 0), &mut |simulator| {
        scenes.push(simulator.scene().context("a picture of every step")?);
        Ok(())
    })?;
    places::make(dir, Existing::Refuse, |dir| {
        for (step, scene) in scenes.iter().enumerate() {
            fs::write(dir.join(format!("step_{step:03}.svg")), scene.to_svg(SCALE as f32))?;
        }
        animate(&scenes, &dir.join("episode.gif"))
    })
    .with_context(|| format!("{}: cannot be written", dir.display()))
}

fn animate(scenes: &[Scene], path: &Path) -> Result<()> {
    let frames: Vec<(usize, usize, Vec<Colour>)> = scenes.iter().map(|scene| scene.to_pixels(SCALE)).collect();
    let (width, height) = (frames[0].0, frames[0].1);
    let mut palette: Vec<Colour> = frames.iter().flat_map(|(_, _, pixels)| pixels.iter().copied()).collect();
    palette.sort_unstable();
    palette.dedup();
    ensure!(palette.len() <= 256, "{} colours, and a GIF holds 256", palette.len());
    let colours: Vec<u8> = palette.iter().flat_map(|colour| colour.0).collect();
    let file = File::create(path)?;
    let mut encoder = gif::Encoder::new(file, width as u16, height as u16, &colours)?;
    encoder.set_repeat(gif::Repeat::Infinite)?;
    for (_, _, pixels) in &frames {
        let indices: Vec<u8> = pixels
            .iter()
            .map(|pixel| palette.binary_search(pixel).expect("the palette holds all pixels") as u8)
            .collect();
        let mut frame =
            gif::Frame { width: width as u16, height: height as u16, delay: STEP_TIME, ..Default::default() };
        frame.buffer = indices.into();
        encoder.write_frame(&frame)?;
    }
    Ok(())
}
