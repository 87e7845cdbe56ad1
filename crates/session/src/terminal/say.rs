//! Printing to standard output and standard error, even if nobody reads them any more. Names in what is printed cannot
//! act on the terminal. And programs as the shell finds them, for commands to copy.

use std::fmt::Display;
use std::io::{ErrorKind, IsTerminal, Write, stderr, stdout};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU8, Ordering};

use anyhow::{Context, Result};

use dials_core::outside::{Printable, is_printable, quoted};

/// How much is printed on standard error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Talk {
    /// Errors and warnings only.
    Quiet,
    Normal,
    /// Also what the work is doing.
    Verbose,
}

static TALK: AtomicU8 = AtomicU8::new(Talk::Normal as u8);

pub fn talk(talk: Talk) {
    TALK.store(talk as u8, Ordering::Relaxed);
}

/// Returns whether as much as this is printed.
pub fn talks(talk: Talk) -> bool {
    TALK.load(Ordering::Relaxed) >= talk as u8
}

/// Returns whether progress bars are shown: on a terminal, unless the process is quiet.
pub fn shows_bars() -> bool {
    stderr().is_terminal() && talks(Talk::Normal)
}

/// Returns a text as it may reach a terminal: no name in it, which others chose, may act on the terminal.
pub(super) fn shown(text: impl Display) -> String {
    let text = text.to_string();
    text.split('\n').map(|line| Printable(line).to_string()).collect::<Vec<_>>().join("\n")
}

/// Returns a JSON text in which names are escaped in JSON's own way, so that [`answer`] finds nothing to escape.
pub fn json(value: impl Display) -> String {
    let mut text = String::new();
    // Outside of strings JSON has no such characters but the ends of lines.
    for letter in value.to_string().chars() {
        if is_printable(letter) || letter == '\n' {
            text.push(letter);
        } else {
            letter.encode_utf16(&mut [0; 2]).iter().for_each(|unit| text += &format!("\\u{unit:04x}"));
        }
    }
    text
}

/// Prints a message on standard error, unless the process is quiet.
pub fn note(line: impl Display) {
    if talks(Talk::Normal) {
        warn(line);
    }
}

/// Prints an error, a warning or what was lost on standard error. If that fails, the work continues.
pub fn warn(line: impl Display) {
    let _ = stderr().write_all(format!("{}\n", shown(line)).as_bytes());
}

/// Prints the result of a command on standard output. If the reader has closed it, as `head` does, this is no error.
pub fn answer(text: impl Display) -> Result<()> {
    let mut out = stdout().lock();
    match out.write_all(format!("{}\n", shown(text)).as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.context("standard output: cannot be written"),
    }
}

const PROGRAM: &str = "dials-traffic";
/// What Linux writes behind the path of a program whose file is another one by now, such as a new build.
const REPLACED: &str = " (deleted)";

/// Returns the name of this program for a command to copy. If the shell would not find it, this is its path.
pub fn program() -> String {
    match std::env::current_exe() {
        Ok(path) if on_the_path(PROGRAM).is_none() => quoted(in_its_place(&path)),
        _ => PROGRAM.to_owned(),
    }
}

/// Returns the path of a program, or of what has replaced it.
fn in_its_place(path: &Path) -> &Path {
    path.to_str().and_then(|path| path.strip_suffix(REPLACED)).map_or(path, Path::new)
}

pub fn on_the_path(program: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(program)).find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_stay_and_nothing_in_them_acts_on_the_terminal() {
        let text = "error: runs/\u{1b}]0;owned\u{7}\u{202E}x: no such folder\n  caused by: \rit\tis not there";
        let printed = "error: runs/\\u{1b}]0;owned\\u{7}\\u{202e}x: no such folder\n  caused by: \\rit\\tis not there";
        assert_eq!(shown(text), printed);
        assert_eq!(shown("ü 交差点 ± [1.0, 2.0]\n\n"), "ü 交差点 ± [1.0, 2.0]\n\n");
    }

    #[test]
    fn a_program_that_was_built_anew_meanwhile_is_named_by_its_place() {
        assert_eq!(in_its_place(Path::new("target/dials-traffic (deleted)")), Path::new("target/dials-traffic"));
        assert_eq!(in_its_place(Path::new("target/dials-traffic")), Path::new("target/dials-traffic"));
    }
}
