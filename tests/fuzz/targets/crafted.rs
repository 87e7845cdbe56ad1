//! Checkpoints that somebody wrote with another state in them: whole, and with a right checksum.

use std::fs;

use dials_core::base::Ragged;
use std::collections::BTreeMap;

use dials_core::base::Dice;
use dials_learn::algorithms::Tables;
use dials_learn::training::state::AgentsState;
use dials_learn::training::stream::AgentStream;
use dials_session::records::checkpoint::{Checkpoint, RunProgress};
use serde::{Deserialize, Serialize};

use crate::place::{copy, empty};
use crate::program;
use crate::run;
use crate::verdict::Verdict;

/// The state of a checkpoint as text, which is mutated: all but the thousands of parameters.
#[derive(Serialize, Deserialize)]
struct State {
    progress: RunProgress,
    steps: u64,
    policies: Vec<usize>,
    learners: BTreeMap<String, Vec<usize>>,
    dice: BTreeMap<String, Vec<Vec<Dice>>>,
    counts: BTreeMap<String, u64>,
    aips: Vec<usize>,
    streams: Vec<AgentStream>,
}

/// Largest number of parameters of a table.
const LARGEST: usize = 1 << 20;

fn original() -> Checkpoint {
    let newest = run::read_checkpoint(&run::dir("half").join("checkpoints")).expect("a whole checkpoint");
    newest.expect("the run has one")
}

pub fn seeds() -> Vec<Vec<u8>> {
    let Checkpoint { agents, progress } = original();
    let widths = |table: &Ragged<f32>| table.widths().collect();
    let state = State {
        progress,
        steps: agents.steps,
        policies: widths(&agents.policies),
        learners: agents.learners.numbers.iter().map(|(name, table)| (name.clone(), widths(table))).collect(),
        dice: agents.learners.dice,
        counts: agents.learners.counts,
        aips: widths(&agents.aips),
        streams: agents.streams,
    };
    vec![serde_json::to_vec_pretty(&state).expect("numbers can be written")]
}

/// The program refuses such a checkpoint, or goes on from it to the end.
pub fn call(bytes: &[u8]) -> Verdict {
    let state: State = match serde_json::from_slice(bytes) {
        Ok(state) => state,
        Err(error) => return Verdict::refused(error),
    };
    let Some(agents) = agents(&state) else { return Verdict::refused("more parameters than are tried") };
    let dir = empty("run");
    copy(&run::dir("half"), &dir);
    let folder = dir.join("checkpoints");
    fs::remove_dir_all(&folder).expect("the run has checkpoints");
    if let Err(error) = run::write_checkpoint(&folder, Checkpoint { agents, progress: state.progress }) {
        return Verdict::refused(error);
    }
    let outcome = program::run(&["train", "--resume", "run", "--workers", "0"]);
    if outcome.code == 0 { Verdict::Accepted } else { Verdict::Refused(outcome.stderr) }
}

/// Returns the agents of a state, with the parameters of the original one, as often as they fit in.
fn agents(state: &State) -> Option<AgentsState> {
    let original = original().agents;
    let table = |values: &Ragged<f32>, widths: &[usize]| {
        let sum =
            widths.iter().try_fold(0_usize, |sum, &width| sum.checked_add(width)).filter(|&sum| sum <= LARGEST)?;
        Ragged::from_vec(values.as_slice().iter().copied().cycle().take(sum).collect(), widths.iter().copied())
    };
    Some(AgentsState {
        steps: state.steps,
        policies: table(&original.policies, &state.policies)?,
        learners: Tables {
            numbers: state
                .learners
                .iter()
                .map(|(name, widths)| Some((name.clone(), table(original.learners.numbers.values().next()?, widths)?)))
                .collect::<Option<_>>()?,
            dice: state.dice.clone(),
            counts: state.counts.clone(),
        },
        aips: table(&original.aips, &state.aips)?,
        streams: state.streams.clone(),
    })
}
