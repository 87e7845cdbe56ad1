//! Pictures of an episode that the domain draws itself.

use anyhow::{Result, ensure};

use super::captions::{DOT, write_text};
use super::letters::HEIGHT;
use super::picture_file::Picture;
use dials_core::domain::{Colour, Scene};
use dials_core::outside::Directory;

/// Least number of pixels per unit of a scene.
const LEAST_SCALE: usize = 16;
/// Length of the longer side of a small scene, in pixels.
const LONGER_SIDE: f32 = 480.0;
/// Height of the band above a picture of the animation, and its colours.
const BAND: usize = 28;
const PAPER: [u8; 3] = [255, 255, 255];
const INK: [u8; 3] = [26, 26, 26];
/// Pixels from the left side to the first letter.
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

fn scale(scene: &Scene) -> usize {
    let [width, height] = scene.size();
    ((LONGER_SIDE / width.max(height)) as usize).max(LEAST_SCALE)
}

/// Returns the picture of a scene, given as width, height and pixels, with a title above.
fn below_title((width, height, pixels): (usize, usize, Vec<Colour>), title: &str) -> Picture {
    let mut picture = Picture::plain([width, BAND], PAPER);
    write_text(&mut picture, title, [GAP, (BAND - HEIGHT * DOT) / 2], INK);
    picture.height += height;
    picture.pixels.extend(pixels.iter().flat_map(|&Colour([red, green, blue])| [red, green, blue, 255]));
    picture
}

fn animate(scenes: &[Scene], titles: &[String]) -> Result<Vec<u8>> {
    let titled = scenes.iter().zip(titles);
    let frames: Vec<Picture> = titled.map(|(scene, title)| below_title(scene.to_pixels(scale(scene)), title)).collect();
    let (width, height) = (frames[0].width as u16, frames[0].height as u16);
    let mut palette: Vec<&[u8]> = frames.iter().flat_map(Picture::colours).collect();
    palette.sort_unstable();
    palette.dedup();
    ensure!(palette.len() <= 256, "{} colours, but a GIF holds at most 256", palette.len());
    let mut bytes = Vec::new();
    let mut encoder = gif::Encoder::new(&mut bytes, width, height, &palette.concat())?;
    encoder.set_repeat(gif::Repeat::Infinite)?;
    for frame in &frames {
        let index = |colour| palette.binary_search(&colour).expect("the palette holds all pixels") as u8;
        let buffer = frame.colours().map(index).collect();
        encoder.write_frame(&gif::Frame { width, height, delay: STEP_TIME, buffer, ..Default::default() })?;
    }
    drop(encoder);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_the_animation_has_its_title_above() {
        let picture = below_title((60, 10, vec![Colour([90; 3]); 600]), "1 step of a long title");
        assert_eq!((picture.width, picture.height, picture.pixels.len()), (60, 10 + BAND, 4 * 60 * (10 + BAND)));
        assert!(picture.colours().skip(60 * BAND).all(|pixel| pixel == [90; 3]));
        // The stroke of the 1 is seven dots high, in its third column.
        let stroke = picture.colours().skip(GAP + 2 * DOT).step_by(60).filter(|&pixel| pixel == INK).count();
        assert_eq!(stroke, 7 * DOT);
    }
}
