//! A folder with a config, in which the program trains.

use std::fs;
use std::path::PathBuf;

use assert_cmd::Command;

pub(crate) struct Place {
    pub(crate) dir: tempfile::TempDir,
}

impl Place {
    /// Makes a folder with this config as `c.toml`.
    pub(crate) fn new(config: &str) -> Place {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("c.toml"), config).unwrap();
        Place { dir }
    }

    /// Returns a command of the program in this folder.
    pub(crate) fn command(&self, words: &[&str]) -> Command {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
        command.current_dir(self.dir.path()).args(words);
        command
    }

    /// Trains in one process. Returns the path of the run.
    pub(crate) fn train(&self, out: &str, more: &[&str]) -> PathBuf {
        self.command(&["train", "c.toml", "--out", out, "--workers", "0"]).args(more).assert().success();
        self.dir.path().join(out)
    }

    pub(crate) fn resume(&self, run: &str) -> Command {
        self.command(&["train", "--resume", run, "--workers", "0"])
    }
}
