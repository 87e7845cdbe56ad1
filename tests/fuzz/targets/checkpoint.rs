//! Checkpoints: a damaged one is refused, or it is the same state.

use std::fs;
use std::sync::OnceLock;

use anyhow::Result;
use dials_session::records::checkpoint::Checkpoint;

use crate::place::empty;
use crate::run;
use crate::verdict::Verdict;

pub fn seeds() -> Vec<Vec<u8>> {
    vec![run::newest_checkpoint(&run::dir("whole")).1]
}

/// Checkpoints that are whole, but of another step or another run: parts of them may get into one.
pub fn strangers() -> Vec<Vec<u8>> {
    ["half", "other"].map(|name| run::newest_checkpoint(&run::dir(name)).1).into()
}

pub fn call(bytes: &[u8]) -> Verdict {
    static STATE: OnceLock<Checkpoint> = OnceLock::new();
    let state = STATE.get_or_init(|| read(&seeds()[0]).expect("a whole checkpoint").expect("it is there"));
    match read(bytes) {
        Err(error) => Verdict::refused(error),
        Ok(None) => panic!("the checkpoint is not seen"),
        Ok(Some(other)) if strangers().iter().any(|stranger| stranger == bytes) => {
            assert!(other != *state, "a stranger is taken for the checkpoint");
            Verdict::Accepted
        }
        Ok(Some(checkpoint)) => {
            assert!(checkpoint == *state, "another state is read: {:?}", checkpoint.progress);
            Verdict::Accepted
        }
    }
}

fn read(bytes: &[u8]) -> Result<Option<Checkpoint>> {
    let folder = empty("checkpoints");
    let (name, _) = run::newest_checkpoint(&run::dir("whole"));
    fs::write(folder.join(name), bytes).expect("a file to work with");
    run::read_checkpoint(&folder)
}
