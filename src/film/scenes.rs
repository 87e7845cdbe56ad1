//! Pictures of an episode that the domain draws itself.

use anyhow::{Result, ensure};

use super::letters::{HEIGHT, dots};
use dials_core::domain::{Colour, Scene};
use dials_core::outside::Directory;

/// Least number of pixels per unit of a scene.
const LEAST_SCALE: usize = 16;
/// Length of the longer side of a small scene, in pixels.
const LONGER_SIDE: f32 = 480.0;
/// Height of the band above a picture of the animation, and its colours.
const BAND: usize = 28;
const PAPER: Colour = Colour([255, 255, 255]);
const INK: Colour = Colour([26, 26, 26]);
/// Pixels of a dot of a letter, and from the left side to the first letter.
const DOT: usize = 2;
const GAP: usize = 8;
/// Time that the animation shows each step, in hundredths of a second.
const STEP_TIME: u16 = 20;

/// Writes `step_NNN.svg` for every scene, and `episode.gif`, into `dir`. `titles`: one per scene.
pub(crate) fn write(scenes: &[Scene], titles: &[String], dir: &Directory) -> Result<()> {
    for (step, (scene, title)) in scenes.iter().zip(titles).enumerate() {
        dir.put(&format!("step_{step:03}.svg"), scene.to_svg(scale(scene) as f32, title).as_bytes())?;
    }
    dir.put("episode.gif", &animate(scenes, titles)?)
}

/// Returns the number of pixels per unit.
fn scale(scene: &Scene) -> usize {
    let [width, height] = scene.size();
    ((LONGER_SIDE / width.max(height)) as usize).max(LEAST_SCALE)
}

/// Returns width, height and pixels of a picture with a title above.
fn below_title((width, height, pixels): (usize, usize, Vec<Colour>), title: &str) -> (usize, usize, Vec<Colour>) {
    let mut band = vec![PAPER; width * BAND];
    for (column, row) in dots(title) {
        let (x, y) = (GAP + column * DOT, (BAND - HEIGHT * DOT) / 2 + row * DOT);
        for dot in 0..DOT * DOT {
            let (x, y) = (x + dot % DOT, y + dot / DOT);
            if x < width {
                band[y * width + x] = INK;
            }
        }
    }
    band.extend(pixels);
    (width, height + BAND, band)
}

/// Returns an animation of the scenes as the bytes of a GIF.
fn animate(scenes: &[Scene], titles: &[String]) -> Result<Vec<u8>> {
    let frames: Vec<(usize, usize, Vec<Colour>)> =
        scenes.iter().zip(titles).map(|(scene, title)| below_title(scene.to_pixels(scale(scene)), title)).collect();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_the_animation_has_its_title_above() {
        let grey = Colour([90, 90, 90]);
        let (width, height, pixels) = below_title((60, 10, vec![grey; 600]), "1 step of a long title");
        assert_eq!((width, height, pixels.len()), (60, 10 + BAND, 60 * (10 + BAND)));
        assert!(pixels[60 * BAND..].iter().all(|&pixel| pixel == grey));
        // The stroke of the 1 is seven dots high, in its third column.
        let stroke = pixels.iter().skip(GAP + 2 * DOT).step_by(60).filter(|&&pixel| pixel == INK).count();
        assert_eq!(stroke, 7 * DOT);
    }
}
