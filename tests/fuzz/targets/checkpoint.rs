//! Checkpoints: a damaged one is refused, or it is the same state.

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use dials_traffic::records::checkpoint::Checkpoint;

use crate::place::empty;
use crate::run;
use crate::verdict::Verdict;

pub fn seeds() -> Vec<Vec<u8>> {
    let files = ["whole", "other"].map(|name| run::checkpoints(&run::dir(name)));
    files.iter().flatten().map(|path| fs::read(path).expect("a checkpoint")).collect()
}

pub fn call(bytes: &[u8]) -> Verdict {
    static STATES: OnceLock<Vec<Checkpoint>> = OnceLock::new();
    let states = STATES.get_or_init(|| {
        let state = |bytes: &Vec<u8>| read(bytes).expect("a whole checkpoint").expect("it is there");
        seeds().iter().map(state).collect()
    });
    match read(bytes) {
        Err(error) => Verdict::refused(error),
        Ok(None) => panic!("the checkpoint is not seen"),
        Ok(Some(checkpoint)) => {
            assert!(states.contains(&checkpoint), "another state is read: {:?}", checkpoint.progress);
            Verdict::Accepted
        }
    }
}

fn read(bytes: &[u8]) -> anyhow::Result<Option<Checkpoint>> {
    let [name, ..] = &run::checkpoints(&run::dir("whole"))[..] else { unreachable!("the run has checkpoints") };
    let folder = empty("checkpoints");
    fs::write(folder.join(Path::new(name).file_name().expect("a file has a name")), bytes)
        .expect("a file to work with");
    Checkpoint::read_newest(&folder)
}
