//! A virtual screen: Xvfb.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;

use anyhow::{Context, Result, ensure};

use super::helper::{Helper, heard, listener, tied};

/// Name of the program.
pub(super) const XVFB: &str = "Xvfb";

/// A virtual screen. Dropping it closes it.
pub(super) struct Screen {
    /// Value of `DISPLAY` for programs on this screen.
    pub name: String,
    _server: Helper,
}

impl Screen {
    pub(super) fn open(width: usize, height: usize, room: &Path) -> Result<Screen> {
        let said = room.join("screen.txt");
        let mut server = tied(XVFB);
        // Xvfb picks a free screen number and writes it to its standard output when it is ready.
        server.args(["-displayfd", "1", "-nolisten", "tcp", "-screen", "0", &format!("{width}x{height}x24")]);
        server.stdout(Stdio::piped()).stderr(listener(&said)?);
        let mut server = Helper::start(server)?;
        let mut number = String::new();
        let out = server.0.stdout.take().expect("standard output is piped");
        BufReader::new(out).read_line(&mut number).context("cannot read the output of Xvfb")?;
        ensure!(!number.trim().is_empty(), "Xvfb opened no screen: {}", heard(&said));
        Ok(Screen { name: format!(":{}", number.trim()), _server: server })
    }
}
