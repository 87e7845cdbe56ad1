//! Joins pictures to a GIF.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result, ensure};

use super::format::STEPS_PER_SECOND;
use crate::terminal::check_stop;
use crate::terminal::counting::EpisodeBar;

/// Writes the GIF `film`, one frame per picture.
pub fn join(frames: &[PathBuf], film: &Path, stop: &AtomicBool) -> Result<()> {
    let bar = EpisodeBar::of(frames.len(), "pictures joined");
    let file = File::create(film).context("the film cannot be written")?;
    let mut encoder: Option<gif::Encoder<File>> = None;
    for (number, frame) in frames.iter().enumerate() {
        check_stop(stop)?;
        let (width, height, mut pixels) = read_picture(frame)?;
        let encoder = match &mut encoder {
            Some(encoder) => encoder,
            None => {
                let mut first = gif::Encoder::new(file.try_clone()?, width, height, &[])?;
                first.set_repeat(gif::Repeat::Infinite)?;
                encoder.insert(first)
            }
        };
        let mut frame = gif::Frame::from_rgba_speed(width, height, &mut pixels, 10);
        frame.delay = 100 / STEPS_PER_SECOND;
        encoder.write_frame(&frame).context("the film cannot be written")?;
        bar.set(number + 1);
    }
    bar.finish();
    Ok(())
}

/// Reads a PNG file. Returns width, height and the pixels, four bytes each.
fn read_picture(path: &Path) -> Result<(u16, u16, Vec<u8>)> {
    let failed = || format!("{}: is not a picture that sumo-gui writes", path.display());
    let file = BufReader::new(File::open(path).with_context(failed)?);
    let mut decoder = png::Decoder::new(file);
    decoder.set_transformations(png::Transformations::ALPHA | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().with_context(failed)?;
    let mut pixels = vec![0; reader.output_buffer_size().with_context(failed)?];
    let info = reader.next_frame(&mut pixels).with_context(failed)?;
    ensure!(info.color_type == png::ColorType::Rgba, "{}: is not in colour", path.display());
    Ok((u16::try_from(info.width)?, u16::try_from(info.height)?, pixels))
}
