//! Pictures of an episode that the domain draws itself.

use anyhow::{Result, ensure};

use crate::domain::{Colour, Scene};
use crate::outside::Directory;

/// Least number of pixels per unit of a scene.
const LEAST_SCALE: usize = 16;
/// Length of the longer side of a small scene, in pixels.
const LONGER_SIDE: f32 = 480.0;
/// Time that the animation shows each step, in hundredths of a second.
const STEP_TIME: u16 = 20;

/// Writes `step_NNN.svg` for every scene, and `episode.gif`, into `dir`. `titles`: one per scene.
pub fn write(scenes: &[Scene], titles: &[String], dir: &Directory) -> Result<()> {
    for (step, (scene, title)) in scenes.iter().zip(titles).enumerate() {
        dir.put(&format!("step_{step:03}.svg"), scene.to_svg(scale(scene) as f32, title).as_bytes())?;
    }
    dir.put("episode.gif", &animate(scenes)?)
}

/// Returns the number of pixels per unit.
fn scale(scene: &Scene) -> usize {
    let [width, height] = scene.size();
    ((LONGER_SIDE / width.max(height)) as usize).max(LEAST_SCALE)
}

/// Returns an animation of the scenes as the bytes of a GIF.
fn animate(scenes: &[Scene]) -> Result<Vec<u8>> {
    let frames: Vec<(usize, usize, Vec<Colour>)> = scenes.iter().map(|scene| scene.to_pixels(scale(scene))).collect();
    let (width, height) = (frames[0].0, frames[0].1);
    let mut palette: Vec<Colour> = frames.iter().flat_map(|(_, _, pixels)| pixels.iter().copied()).collect();
    palette.sort_unstable();
    palette.dedup();
    ensure!(palette.len() <= 256, "{} colours, but a GIF holds at most 256", palette.len());
    let colours: Vec<u8> = palette.iter().flat_map(|colour| colour.0).collect();
    let mut bytes = Vec::new();
    let mut encoder = gif::Encoder::new(&mut bytes, width as u16, height as u16, &colours)?;
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
    drop(encoder);
    Ok(bytes)
}
