//! `replay --video`: films a replay.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, ensure};

use super::outputs::check_free;
use super::places::{self, Existing};
use crate::error::{self, Error};
use crate::film::{Format, Pictures, Replay};
use crate::outside::folder_of;
use crate::terminal::stop_on_signals;

/// A film that can be made: its tools and its folder were checked.
pub struct Video {
    file: PathBuf,
    format: Format,
    existing: Existing,
}

impl Video {
    /// Checks the tools and the output file before any work begins.
    pub fn asked_for(file: &Path, existing: Existing) -> Result<Video> {
        let format =
            Format::of(file).with_context(|| format!("--video {}: must end in .gif or .mp4", file.display()))?;
        format.check_tools("--video")?;
        check_free(file, "--video", existing)?;
        let folder = folder_of(file);
        ensure!(folder.is_dir(), "{}: there is no such directory for the film; make it first", folder.display());
        Ok(Video { file: file.to_owned(), format, existing })
    }

    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Films a replay. Ctrl-C stops this and leaves no file behind.
    pub fn make(&self, replay: &Replay) -> error::Result<()> {
        let stop = stop_on_signals(|_| ()).map_err(Error::Run)?;
        match self.film(replay, &stop) {
            Err(_) if stop.load(Ordering::Relaxed) => {
                Err(Error::Interrupted(format!("stopped; {} was not made", self.file.display())))
            }
            done => done.map_err(Error::Run),
        }
    }

    fn film(&self, replay: &Replay, stop: &AtomicBool) -> Result<()> {
        let pictures = Pictures::take(replay, stop)?;
        places::make_file(&self.file, self.existing, |beside| pictures.join(self.format, beside, stop))
    }
}
