//! The folder in which inputs are tried, a folder beside it that must stay as it is, and the program, run in there.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dials_core::outside::is_printable;
use tempfile::TempDir;

use super::runs::Runs;

const CANARY: (&str, &str) = ("canary", "this file belongs to somebody else\n");

pub(crate) struct Place {
    root: TempDir,
    runs: OnceCell<Runs>,
}

/// What the program said, and its exit code.
pub(crate) struct Outcome {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Place {
    pub(crate) fn new() -> Place {
        let place = Place { root: tempfile::tempdir().expect("a temporary folder"), runs: OnceCell::new() };
        fs::create_dir(place.work()).expect("a new folder");
        place.make_outside();
        place
    }

    /// Returns trained runs, which are made when they are first needed.
    pub(crate) fn runs(&self) -> &Runs {
        self.runs.get_or_init(Runs::make)
    }

    /// Returns the folder to work in.
    pub(crate) fn work(&self) -> PathBuf {
        self.root.path().join("work")
    }

    /// Writes a file to work with.
    pub(crate) fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.work().join(name);
        fs::write(&path, bytes).expect("a file to work with");
        path
    }

    /// Makes an empty folder of this name to work in.
    pub(crate) fn empty(&self, name: &str) -> PathBuf {
        let folder = self.work().join(name);
        match fs::remove_dir_all(&folder) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => panic!("{}: {error}", folder.display()),
            _ => fs::create_dir_all(&folder).expect("a folder to work in"),
        }
        folder
    }

    fn outside(&self) -> PathBuf {
        self.root.path().join("outside")
    }

    fn make_outside(&self) {
        fs::create_dir(self.outside()).expect("its place is free");
        fs::write(self.outside().join(CANARY.0), CANARY.1).expect("a new file");
    }

    /// Panics if a file outside was changed, added or removed; repairs it first.
    pub(crate) fn check_outside(&self) {
        let entries = fs::read_dir(self.outside()).into_iter().flatten().flatten();
        let found: BTreeMap<_, _> =
            entries.map(|entry| (entry.file_name(), fs::read(entry.path()).unwrap_or_default())).collect();
        if found.into_iter().ne([(CANARY.0.into(), CANARY.1.as_bytes().to_vec())]) {
            fs::remove_dir_all(self.outside()).expect("a folder of this process");
            self.make_outside();
            panic!("a file outside was touched");
        }
    }

    /// Runs the program where SUMO may die, if the program says so. Returns the code, or 128 and the number of the signal.
    pub(crate) fn program_or_sumos_death(&self, arguments: &[&str]) -> Outcome {
        run(&self.work(), arguments, |stderr| {
            stderr.contains("SUMO died ") || stderr.contains("SUMO did not come back ")
        })
    }

    /// Runs the program in the folder to work in.
    pub(crate) fn program(&self, arguments: &[&str]) -> Outcome {
        program(&self.work(), arguments)
    }
}

/// Runs the program. Panics if it was ended by a signal, panicked, hung, returned an unknown exit code, or said what is
/// not printable.
pub(crate) fn program(folder: &Path, arguments: &[&str]) -> Outcome {
    run(folder, arguments, |_| false)
}

/// Runs the program. `may_die`: whether what it said allows that a signal ends it.
fn run(folder: &Path, arguments: &[&str], may_die: impl Fn(&str) -> bool) -> Outcome {
    let mut command = assert_cmd::Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
    let output = command.args(arguments).current_dir(folder).timeout(Duration::from_secs(100)).output();
    let output = output.expect("the program is built");
    let [stdout, stderr] = [output.stdout, output.stderr].map(|said| String::from_utf8_lossy(&said).into_owned());
    let said = || format!("with {arguments:?}, and said: {}", stderr.chars().take(2_000).collect::<String>());
    let signal = output.status.signal().filter(|_| may_die(&stderr)).map(|signal| 128 + signal);
    let Some(code) = output.status.code().or(signal) else {
        panic!("the program hung or was ended by a signal {}", said())
    };
    assert!(
        (signal.is_some() || [0, 1, 2].contains(&code)) && !stderr.contains("panicked at"),
        "the program ended with {code} {}",
        said()
    );
    let bad = stdout.chars().chain(stderr.chars()).find(|&letter| letter != '\n' && !is_printable(letter));
    assert!(bad.is_none(), "the program printed {bad:?} {}", said());
    Outcome { code, stdout, stderr }
}

/// Copies a folder with what is in it.
pub(crate) fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder to work in");
    for entry in fs::read_dir(from).unwrap_or_else(|error| panic!("{}: {error}", from.display())).flatten() {
        let (path, copied) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &copied);
        } else {
            fs::copy(&path, &copied).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        }
    }
}
