//! CSV files of a run that is resumed from its first checkpoint.

use std::fs;

use dials_session::records::files::{GROWING, POLICIES};

use crate::place::{copy, empty};
use crate::program;
use crate::run;
use crate::verdict::Verdict;

/// The first line of an input names the file, the rest is its content.
pub fn seeds() -> Vec<Vec<u8>> {
    let dir = run::dir("half");
    let there = GROWING.iter().filter(|name| dir.join(name).is_file());
    there.map(|name| [name.as_bytes(), b"\n", &fs::read(dir.join(name)).expect("a file of the run")].concat()).collect()
}

/// A resume that succeeds gives the policies of the run that nobody disturbed.
pub fn call(bytes: &[u8]) -> Verdict {
    let line = bytes.iter().position(|&byte| byte == b'\n').unwrap_or(bytes.len());
    let (name, content) = bytes.split_at(line);
    let Some(name) = GROWING.iter().find(|known| known.as_bytes() == name) else {
        return Verdict::refused("no such file");
    };
    let dir = empty("run");
    copy(&run::dir("half"), &dir);
    fs::write(dir.join(name), content.get(1..).unwrap_or(&[])).expect("a file to work with");
    let outcome = program::run(&["train", "--resume", "run", "--workers", "0"]);
    if outcome.code != 0 {
        return Verdict::Refused(outcome.stderr);
    }
    let policies = |dir: &std::path::Path| fs::read(dir.join(POLICIES)).expect("a run that is done has policies");
    assert!(policies(&dir) == policies(&run::dir("whole")), "the resumed run learned something else");
    Verdict::Accepted
}
