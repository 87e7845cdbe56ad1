//! The formats of a film, and the programs that each needs.

use std::path::Path;

use anyhow::{Result, ensure};

use super::gui::SUMO_GUI;
use super::helper::SETPRIV;
use super::screen::XVFB;
use dials_session::terminal::on_the_path;

/// Number of steps that a film shows per second.
pub(super) const STEPS_PER_SECOND: u16 = 10;

/// The format of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Gif,
    Mp4,
}

impl Format {
    /// Returns the format for the ending of a file name. Any other ending: `None`.
    pub(crate) fn of(file: &Path) -> Option<Format> {
        match file.extension().and_then(|ending| ending.to_str()) {
            Some("gif") => Some(Format::Gif),
            Some("mp4") => Some(Format::Mp4),
            _ => None,
        }
    }

    /// Checks that all programs for such a film are installed. The error says what to install. `option`: the flag to
    /// name in it.
    pub(crate) fn check_tools(self, option: &str) -> Result<()> {
        let mut tools = vec![(SUMO_GUI, "sumo"), (XVFB, "xvfb"), (SETPRIV, "util-linux")];
        if self == Format::Mp4 {
            tools.push(("ffmpeg", "ffmpeg"));
        }
        for (tool, package) in tools {
            let gif = if tool == "ffmpeg" { ", or make a .gif, which does not need it" } else { "" };
            let way_out = format!("install Debian's package {package}{gif}");
            ensure!(on_the_path(tool).is_some(), "{option}: {tool} is not on the PATH: {way_out}");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_of_a_file_names_its_format() {
        let of = |file: &str| Format::of(Path::new(file));
        assert_eq!([of("a/b.gif"), of("b.mp4")], [Some(Format::Gif), Some(Format::Mp4)]);
        assert_eq!([of("b.avi"), of("gif"), of(".gif")], [None; 3]);
    }
}
