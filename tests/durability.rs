//! What is on the disk when the power fails: a checkpoint gets its name after all that it counts on.
//!
//! Only the system sees the order of writes and syncs, so `strace` records it. No test can lose power.

use std::collections::BTreeSet;
use std::fs;
use std::io::{Write, stderr};
use std::path::{Path, PathBuf};
use std::process::Command;

const CONFIG: &str = "total_steps = 640\n[warehouse]\nagents_per_side = 2\nhorizon = 16\n\
                      [policy]\nhidden = [16]\n[ppo]\nrollout_steps = 8\n\
                      [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 64\nbatch = 16\nepochs = 2\n\
                      [evaluation]\nevery_steps = 128\nepisodes = 2\n";
const CALLS: &str = "write,writev,pwrite64,fsync,fdatasync,openat,rename,renameat,renameat2,unlinkat,rmdir";

/// What is not yet on the disk.
struct Disk {
    /// Folder of everything that counts.
    place: PathBuf,
    /// Files with bytes that were written since their last sync.
    files: BTreeSet<PathBuf>,
    /// Directories in which a name was made since their last sync.
    names: BTreeSet<PathBuf>,
    /// Number of checkpoints that got their names.
    checkpoints: usize,
}

impl Disk {
    /// Follows one call; `line`: as `strace -y` writes it.
    fn follow(&mut self, line: &str) {
        let (opened, named) = (between(line, '<', '>'), between(line, '"', '"'));
        let place = |index: usize| {
            opened.get(index).map_or(PathBuf::from(named[index]), |directory| Path::new(directory).join(named[index]))
        };
        match line.split_once('(').map_or("", |(call, _)| call) {
            "write" | "writev" | "pwrite64" => drop(self.files.insert(PathBuf::from(opened[0]))),
            "fsync" | "fdatasync" => {
                self.files.remove(Path::new(opened[0]));
                self.names.remove(Path::new(opened[0]));
            }
            "openat" if line.contains("O_CREAT") => {
                let made = opened.last().map(Path::new).and_then(Path::parent);
                made.map(|directory| self.names.insert(directory.to_owned()));
            }
            "rename" | "renameat" | "renameat2" => self.rename(&place(0), &place(1), line),
            "rmdir" => drop(self.names.remove(Path::new(named[0]))),
            "unlinkat" if line.contains("AT_REMOVEDIR") => drop(self.names.remove(&place(0))),
            "unlinkat" if is_checkpoint(Path::new(named[0])) => {
                assert!(
                    !self.names.contains(&self.place.join("run/checkpoints")),
                    "the new checkpoint may not be there yet: {line}"
                );
            }
            _ => (),
        }
    }

    fn rename(&mut self, from: &Path, to: &Path, line: &str) {
        if !to.starts_with(&self.place) {
            return;
        }
        let late = self.late(from);
        assert!(late.is_empty(), "{late:?} are not on the disk: {line}");
        if is_checkpoint(to) {
            self.checkpoints += 1;
            let late: Vec<_> =
                self.files.iter().filter(|path| path.extension().is_some_and(|it| it == "csv")).collect();
            assert!(late.is_empty(), "{late:?} are not on the disk: {line}");
            assert!(!self.names.contains(&self.place.join("run")), "new files are not on the disk: {line}");
        }
        to.parent().map(|directory| self.names.insert(directory.to_owned()));
    }

    /// Returns the files and directories from `path` on that have something that is not on the disk.
    fn late(&self, path: &Path) -> Vec<&Path> {
        self.files.union(&self.names).map(PathBuf::as_path).filter(|late| late.starts_with(path)).collect()
    }
}

fn is_checkpoint(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("step_"))
}

/// Returns the texts between two marks.
fn between(line: &str, open: char, close: char) -> Vec<&str> {
    let (mut found, mut rest) = (Vec::new(), line);
    while let Some((text, after)) = rest.split_once(open).and_then(|(_, rest)| rest.split_once(close)) {
        found.push(text);
        rest = after;
    }
    found
}

#[test]
fn a_checkpoint_gets_its_name_when_all_that_it_counts_on_is_on_the_disk() {
    let possible = Command::new("strace").args(["-o", "/dev/null", "true"]).output();
    if !possible.as_ref().is_ok_and(|output| output.status.success()) {
        // Not `eprintln`, which is hidden when a test passes.
        let line = format!("not tested: the order of syncs: strace cannot be used here: {possible:?}\n");
        return stderr().write_all(line.as_bytes()).unwrap();
    }
    let dir = tempfile::tempdir().unwrap();
    let place = dir.path().canonicalize().unwrap();
    fs::write(place.join("c.toml"), CONFIG).unwrap();
    let mut command = Command::new("strace");
    command.args(["-f", "-qq", "-y", "-o", "trace", "-e", &format!("trace={CALLS}"), "-e", "signal=none"]);
    command.args([env!("CARGO_BIN_EXE_dials-traffic"), "train", "c.toml", "--out", "run", "--workers", "0"]);
    let output = command.current_dir(&place).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut disk = Disk { place: place.clone(), files: BTreeSet::new(), names: BTreeSet::new(), checkpoints: 0 };
    for line in fs::read_to_string(place.join("trace")).unwrap().lines() {
        // Each line begins with the id of its thread.
        let line = line.trim_start_matches(|letter: char| letter.is_ascii_digit()).trim_start();
        disk.follow(line);
    }
    assert_eq!(disk.checkpoints, 5);
    assert_eq!(disk.late(&place), [Path::new(""); 0]);
}
