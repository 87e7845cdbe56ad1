//! Joins pictures to an mp4, with ffmpeg.

use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, ensure};

use super::captions::PAPER;
use super::format::STEPS_PER_SECOND;
use super::helper::{Helper, heard, listener, tied};
use dials_session::terminal::check_stop;

/// Writes the mp4 `film` from the pictures in the folder `room`. Ends with an error soon after `stop` is set.
pub(super) fn join(room: &Path, film: &Path, stop: &AtomicBool) -> Result<()> {
    let [red, green, blue] = PAPER;
    let said = room.join("ffmpeg.txt");
    let mut ffmpeg = tied("ffmpeg");
    ffmpeg
        .args(["-loglevel", "error", "-framerate", &STEPS_PER_SECOND.to_string(), "-i"])
        .arg(room.join("%06d.png"))
        // Every player can show an even width and height with this pixel format.
        .args([
            "-vf",
            &format!("pad=ceil(iw/2)*2:ceil(ih/2)*2:color=0x{red:02x}{green:02x}{blue:02x}"),
            "-pix_fmt",
            "yuv420p",
            "-movflags",
            "+faststart",
        ])
        .arg(film)
        .stdout(Stdio::null())
        .stderr(listener(&said)?);
    let mut ffmpeg = Helper::start(ffmpeg)?;
    let status = loop {
        check_stop(stop)?;
        if let Some(status) = ffmpeg.0.try_wait().context("cannot wait for ffmpeg")? {
            break status;
        }
        thread::sleep(Duration::from_millis(20));
    };
    ensure!(status.success(), "ffmpeg failed ({status}): {}", heard(&said));
    check_stop(stop)
}
