//! Joins pictures to a GIF.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result};

use super::format::STEPS_PER_SECOND;
use super::picture_file::Picture;
use dials_session::terminal::check_stop;
use dials_session::terminal::counting::EpisodeBar;

/// Writes the GIF `film`, one frame per picture.
pub(super) fn join(frames: &[PathBuf], film: &Path, stop: &AtomicBool) -> Result<()> {
    let bar = EpisodeBar::of(frames.len(), "pictures joined");
    let file = File::create(film).context("the film cannot be written")?;
    let mut encoder: Option<gif::Encoder<File>> = None;
    for (number, frame) in frames.iter().enumerate() {
        check_stop(stop)?;
        let Picture { width, height, mut pixels } = Picture::read(frame)?;
        let (width, height) = (u16::try_from(width)?, u16::try_from(height)?);
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
