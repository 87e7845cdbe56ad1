//! `replay --video`: films a replay.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, ensure};

use crate::film::{self, Format, Replay};
use dials_core::outside::{folder_of, temporary_dir};
use dials_session::error::{self, Error};
use dials_session::outputs::check_free;
use dials_session::places::{self, Existing};
use dials_session::terminal::{Wish, stop_on_signals, warn};

/// A film that can be made: its tools and its folder were checked.
pub(super) struct Video {
    file: PathBuf,
    format: Format,
    existing: Existing,
}

impl Video {
    /// Checks the tools and the output file before any work begins.
    pub(super) fn asked_for(file: &Path, existing: Existing) -> Result<Video> {
        let format =
            Format::of(file).with_context(|| format!("--video {}: must end in .gif or .mp4", file.display()))?;
        format.check_tools("--video")?;
        check_free(file, "--video", existing)?;
        let folder = folder_of(file);
        ensure!(folder.is_dir(), "{}: there is no such directory for the film; make it first", folder.display());
        Ok(Video { file: file.to_owned(), format, existing })
    }

    pub(super) fn file(&self) -> &Path {
        &self.file
    }

    /// Films a replay. Ctrl-C stops this and leaves no file behind.
    pub(super) fn make(&self, replay: &Replay) -> error::Result<()> {
        let room = temporary_dir().context("the pictures have no place").map_err(Error::Run)?;
        let last_words = format!("stopped; {} was not made", self.file.display());
        let (pictures, words) = (room.path().to_owned(), last_words.clone());
        let stop = stop_on_signals(move |wish| {
            if wish == Wish::StopNow {
                warn(&words);
                // The process ends without its destructors.
                let _ = fs::remove_dir_all(&pictures);
            }
        });
        let stop = stop.map_err(Error::Run)?;
        match self.film(replay, room.path(), &stop) {
            Err(_) if stop.load(Ordering::Relaxed) => Err(Error::Interrupted(last_words)),
            done => done.map_err(Error::Run),
        }
    }

    fn film(&self, replay: &Replay, room: &Path, stop: &AtomicBool) -> Result<()> {
        let pictures = film::take(replay, room, stop)?;
        places::make_file(&self.file, self.existing, |beside| film::join(&pictures, self.format, beside, stop))
    }
}
