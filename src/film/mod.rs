//! Films of episodes: GIF and mp4.
//!
//! - `pictures`: sumo-gui takes one picture per step on a virtual screen, and they are joined to a film.
//! - `captions`: what pictures show besides the roads, in `letters`. `picture_file`: their files.
//! - `programs`: other programs, which end together with this one.
//! - [`scenes`]: pictures that a domain draws itself, as SVG files and as one GIF.
//!
//! A replay is a folder that sumo-gui plays. Nothing here knows how the episode was made.

mod captions;
mod letters;
mod picture_file;
mod pictures;
mod programs;
pub(crate) mod scenes;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

use captions::SpeedColour;
use dials_core::outside::quoted;
use dials_session::terminal::on_the_path;
use dials_traffic::sumo_program;

pub(crate) use pictures::{join, take};

/// Returns the file of sumo-gui.
fn sumo_gui() -> Result<PathBuf> {
    sumo_program("sumo-gui").context("sumo-gui was not found: pip install eclipse-sumo, or on Debian apt install sumo")
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Gif,
    Mp4,
}

impl Format {
    /// Returns the format for the ending of a file name. Any other ending: `None`.
    pub(crate) fn of(file: &Path) -> Option<Format> {
        match file.extension()?.to_str()? {
            "gif" => Some(Format::Gif),
            "mp4" => Some(Format::Mp4),
            _ => None,
        }
    }

    /// Checks that all programs for such a film are installed.
    pub(crate) fn check_tools(self) -> Result<()> {
        sumo_gui().context("--video")?;
        let mut tools = vec![(programs::XVFB, "xvfb"), (programs::SETPRIV, "util-linux")];
        if self == Format::Mp4 {
            tools.push(("ffmpeg", "ffmpeg, or make a .gif, which does not need it"));
        }
        for (tool, package) in tools {
            ensure!(
                on_the_path(tool).is_some(),
                "--video: {tool} is not on the PATH: install Debian's package {package}"
            );
        }
        Ok(())
    }
}

pub(crate) struct Replay<'a> {
    pub(crate) title: &'a str,
    /// Colours of cars, from the slowest on.
    pub(crate) speeds: &'a [SpeedColour],
    /// Path of the file for `sumo-gui -c`.
    pub(crate) config: &'a Path,
    /// Steps that are shown; each becomes one picture.
    pub(crate) steps: Range<usize>,
    pub(crate) begin_s: u64,
    pub(crate) shape: Shape,
    /// Function that returns settings with which sumo-gui writes these pictures, the i-th before the i-th of these steps.
    pub(crate) settings: &'a dyn Fn(&[PathBuf]) -> String,
}

/// The roads, which give a film its shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Shape {
    /// Numbers of intersections from west to east and from south to north.
    Grid { columns: usize, rows: usize },
    /// Extent from west to east and from south to north, in metres.
    Map { wide_m: f64, tall_m: f64 },
}

/// Checks that sumo-gui can be opened for a person. The error says what to do.
pub(crate) fn check_screen() -> Result<()> {
    sumo_gui().context("--gui")?;
    ensure!(
        std::env::var_os("DISPLAY").is_some_and(|display| !display.is_empty()),
        "--gui: there is no screen here (DISPLAY is not set); make a film with --video, or leave --gui \
         out and open the folder with sumo-gui elsewhere"
    );
    Ok(())
}

pub(crate) fn watch(config: &Path) -> Result<()> {
    let status = Command::new(sumo_gui()?).arg("-c").arg(config).arg("--start").status();
    let status = status.context("sumo-gui could not be started")?;
    ensure!(
        status.success(),
        "sumo-gui ended with {status}; the folder is complete, try to open it with: sumo-gui -c {}",
        quoted(config)
    );
    Ok(())
}
