//! What is on the disk when the power fails: a checkpoint gets its name after all that it counts on.
//!
//! Only the system sees the order of writes and syncs, so `strace` records it. No test can lose power.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{Write, stderr};
use std::path::{Path, PathBuf};
use std::process::Command;

const CONFIG: &str = "total_steps = 640\n[warehouse]\nagents_per_side = 2\nhorizon = 16\n\
                      [policy]\nhidden = [16]\n[ppo]\nrollout_steps = 8\n\
                      [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 64\nbatch = 16\nepochs = 2\n\
                      [evaluation]\nevery_steps = 128\nepisodes = 2\n";
const CALLS: &str = "write,writev,pwrite64,fsync,fdatasync,openat,mkdir,mkdirat,rename,renameat,renameat2,unlink,\
                     unlinkat,rmdir";

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
    /// Follows one call; `line`: as `strace -y` writes it. A call that failed has changed nothing.
    fn follow(&mut self, line: &str) {
        if line.rsplit_once(" = ").is_some_and(|(_, result)| result.starts_with("-1 ")) {
            return;
        }
        let (opened, named) = (between(line, '<', '>'), between(line, '"', '"'));
        let place = |index: usize| {
            let directory = opened.get(index).map_or(self.place.as_path(), Path::new);
            directory.join(named[index])
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
            "mkdir" | "mkdirat" => drop(place(0).parent().map(|directory| self.names.insert(directory.to_owned()))),
            "rename" | "renameat" | "renameat2" => self.rename(&place(0), &place(1), line),
            "rmdir" => drop(self.names.remove(&place(0))),
            "unlinkat" if line.contains("AT_REMOVEDIR") => drop(self.names.remove(&place(0))),
            "unlink" | "unlinkat" if is_checkpoint(Path::new(named[0])) => {
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

/// Returns the calls of a trace, each whole and where it ended. A call that another thread interrupts has two lines.
fn calls(trace: &str) -> Vec<String> {
    let (mut calls, mut begun) = (Vec::new(), BTreeMap::new());
    for line in trace.lines() {
        // Each line begins with the id of its thread.
        let (thread, call) = line.split_once(' ').unwrap_or((line, ""));
        let call = call.trim_start();
        if let Some(beginning) = call.strip_suffix(" <unfinished ...>") {
            begun.insert(thread, beginning);
        } else if let Some((_, end)) = call.strip_prefix("<... ").and_then(|rest| rest.split_once(" resumed>")) {
            // A thread may have begun before it was traced.
            calls.extend(begun.remove(thread).map(|beginning| format!("{beginning}{end}")));
        } else {
            calls.push(call.to_owned());
        }
    }
    calls
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
fn calls_that_were_interrupted_are_followed_as_whole_ones() {
    let trace = "11 write(3</d/a.csv>, \"x\", 1 <unfinished ...>\n\
                 12    fsync(4</d>) = 0\n\
                 11 <... write resumed>) = 1\n\
                 12 mkdirat(4</d>, \"new\", 0777) = 0\n\
                 12 mkdir(\"old\", 0777) = -1 EEXIST (File exists)\n\
                 13 <... fsync resumed>) = 0\n\
                 11 exit_group(0 <unfinished ...>\n";
    let whole = ["fsync(4</d>) = 0", "write(3</d/a.csv>, \"x\", 1) = 1", "mkdirat(4</d>, \"new\", 0777) = 0"];
    let calls = calls(trace);
    assert_eq!(calls[..3], whole);
    let place = PathBuf::from("/d/within");
    let mut disk = Disk { place, files: BTreeSet::new(), names: BTreeSet::new(), checkpoints: 0 };
    calls.iter().for_each(|call| disk.follow(call));
    // The folder that was there already has no new name.
    assert_eq!(disk.late(Path::new("/")), [Path::new("/d"), Path::new("/d/a.csv")]);
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
    calls(&fs::read_to_string(place.join("trace")).unwrap()).iter().for_each(|call| disk.follow(call));
    assert_eq!(disk.checkpoints, 5);
    assert_eq!(disk.late(&place), Vec::<&Path>::new());
}
