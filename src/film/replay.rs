//! A replay becomes a film.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, ensure};
use tempfile::TempDir;

use super::pictures::take_pictures;
use super::{Format, gif, mp4};

/// An episode that sumo-gui plays.
pub struct Replay<'a> {
    /// Path of what `sumo-gui -c` takes.
    pub config: &'a Path,
    /// Number of steps, each of which is a picture.
    pub steps: usize,
    /// Intersections from west to east and from south to north, which give the film its shape.
    pub columns: usize,
    pub rows: usize,
    /// Returns sumo-gui's settings under which it writes these pictures, the i-th before step i.
    pub settings: &'a dyn Fn(&[PathBuf]) -> String,
}

/// The pictures of a replay, in a temporary place. Taking and joining end with an error soon after `stop` is set.
pub struct Pictures {
    room: TempDir,
    files: Vec<PathBuf>,
}

impl Pictures {
    pub fn take(replay: &Replay, stop: &AtomicBool) -> Result<Pictures> {
        let room = tempfile::tempdir().context("no temporary directory for the pictures")?;
        let files = take_pictures(replay, room.path(), stop)?;
        Ok(Pictures { room, files })
    }

    /// Writes the film.
    pub fn join(&self, format: Format, film: &Path, stop: &AtomicBool) -> Result<()> {
        match format {
            Format::Gif => gif::join(&self.files, film, stop),
            Format::Mp4 => mp4::join(self.room.path(), film),
        }
    }
}

/// An error after Ctrl-C.
pub(super) fn check(stop: &AtomicBool) -> Result<()> {
    ensure!(!stop.load(Ordering::Relaxed), "stopped");
    Ok(())
}
