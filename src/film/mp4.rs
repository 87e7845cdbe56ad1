//! Joins pictures to an mp4, with ffmpeg.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use super::captions::PAPER;
use super::format::STEPS_PER_SECOND;

/// Writes the mp4 `film` from the pictures in the folder `room`.
pub fn join(room: &Path, film: &Path) -> Result<()> {
    let [red, green, blue] = PAPER;
    let output = Command::new("ffmpeg")
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
        .stdin(Stdio::null())
        .output()
        .context("ffmpeg could not be started")?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "ffmpeg failed ({}): {}", output.status, said.trim());
    Ok(())
}
