//! Checkpoints that somebody wrote with another state in them: whole, and with a right checksum.

use std::fs;

use dials_traffic::records::checkpoint::{Checkpoint, RunProgress};
use dials_traffic::training::state::AgentsState;
use serde::{Deserialize, Serialize};

use crate::place::{copy, empty};
use crate::program;
use crate::run;
use crate::verdict::Verdict;

/// The state of a checkpoint as text, which is mutated.
#[derive(Serialize, Deserialize)]
struct State {
    progress: RunProgress,
    agents: AgentsState,
}

pub fn seeds() -> Vec<Vec<u8>> {
    let newest = run::read_checkpoint(&run::dir("half").join("checkpoints")).expect("a whole checkpoint");
    let Checkpoint { agents, progress } = newest.expect("the run has one");
    vec![serde_json::to_vec_pretty(&State { progress, agents }).expect("numbers can be written")]
}

/// The program refuses such a checkpoint, or goes on from it to the end.
pub fn call(bytes: &[u8]) -> Verdict {
    let State { progress, agents } = match serde_json::from_slice(bytes) {
        Ok(state) => state,
        Err(error) => return Verdict::refused(error),
    };
    let dir = empty("run");
    copy(&run::dir("half"), &dir);
    let folder = dir.join("checkpoints");
    fs::remove_dir_all(&folder).expect("the run has checkpoints");
    if let Err(error) = run::write_checkpoint(&folder, Checkpoint { agents, progress }) {
        return Verdict::refused(error);
    }
    let outcome = program::run(&["train", "--resume", "run", "--workers", "0"]);
    if outcome.code == 0 { Verdict::Accepted } else { Verdict::Refused(outcome.stderr) }
}
