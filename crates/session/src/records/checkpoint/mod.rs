//! Checkpoints: the state of all agents in a file from which a run continues as if it had not stopped.
//!
//! A safetensors file (little-endian, like all machines on which Debian's libtorch runs). It has one table each for
//! policies, moments and AIPs, one agent after another, and the bytes of all agents' streams. Its metadata holds the
//! other state, and the config and the scenario that it was trained with. A checkpoint is written after every period; the
//! last [`KEPT`] are kept.
//!
//! Nothing is restored from a file that does not fit the run in every way:
//!
//! - a digest: the bytes are those that were written.
//! - [`owner`]: the run that it belongs to: what of the config and of the scenario may have changed since.
//! - [`fits`](dials_learn::state::fits): sizes, actions, trails and counts, each of which follows from the config.
//!
//! # Why not otherwise
//!
//! **Why safetensors, and not one serialised struct?** A struct is shorter to write. But every field that is added
//! makes the old files unreadable, and no other program can open them. The tables of a checkpoint open in Python,
//! without this program.
//!
//! **Why is a file that parses not believed?** It can be whole and of another run, of another config, or cut off and
//! filled with zeros by a power loss. Each of these trains on without an error, and gives wrong numbers hours later. So
//! the digest says that the bytes are those that were written, the owner says whose they are, and all sizes and counts
//! are compared with what the config gives.
//!
//! **Why several, and not the last one?** The growing files of a run, such as `returns.csv`, may have lost bytes that
//! the newest checkpoint counts on. Then an earlier one still fits.

pub mod owner;

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::files;
use super::growing::Mark;
use crate::config::resume::{from_json, to_json};
use dials_core::base::{AgentId, Dice, Ragged};
use dials_core::outside::Directory;
use dials_learn::algorithms::{self, Layout, Tables};
use dials_learn::progress::TrainingProgress;
use dials_learn::state::AgentsState;
use dials_learn::state::fits::{Fit, Widths};
use dials_learn::state::stream::AgentStream;
use owner::{NotOfThisRun, Owner};

/// Number of checkpoints that are kept, the newest ones.
pub(crate) const KEPT: usize = 3;
/// Largest file. That of 10 000 agents with 100 000 parameters each is smaller.
const LARGEST_FILE: u64 = 32 << 30;
const FORMAT: &str = "dials-traffic checkpoint 1";

/// State of a run after a period.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    pub agents: AgentsState,
    pub progress: RunProgress,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunProgress {
    /// Where Algorithm 1 continues.
    pub standing: TrainingProgress,
    /// How far every growing file has come.
    pub growing: BTreeMap<String, Mark>,
    /// Wall time of the run so far.
    pub elapsed_s: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Metadata {
    format: String,
    version: String,
    steps: u64,
    config: Value,
    scenario: Value,
    progress: RunProgress,
}

const POLICIES: &str = "policies";
const AIPS: &str = "aips";
/// Beginning of the names of the learners' tables.
const LEARNERS: &str = "learners.";
/// Name of what is no table of numbers, in postcard's format: the agents' streams, the learners' dice and counts.
const STREAMS: &str = "streams";
/// Name of the bytes of a learner outside of this program. Other learners have none.
const OUTSIDE: &str = "outside";
/// Name of the bytes of a predictor outside of this program. Other predictors have none.
const OUTSIDE_AIPS: &str = "outside_aips";
type Streams = (Vec<AgentStream>, BTreeMap<String, Vec<Vec<Dice>>>, BTreeMap<String, u64>);

/// Writes a checkpoint of a run into `folder` and removes those that are no longer kept.
pub fn write(folder: &Directory, owner: &Owner, agents: &AgentsState, progress: RunProgress) -> Result<()> {
    let AgentsState { policies, learners, aips, streams, outside_aips, .. } = agents;
    let streams = postcard::to_stdvec(&(streams, &learners.dice, &learners.counts))
        .context("the state of training cannot be encoded")?;
    let about = Metadata {
        format: FORMAT.to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        steps: agents.steps,
        config: to_json(&owner.config),
        scenario: owner.scenario.clone(),
        progress,
    };
    let of_learners = learners.numbers.iter().map(|(name, table)| (format!("{LEARNERS}{name}"), table));
    let tables = [(POLICIES.to_owned(), policies), (AIPS.to_owned(), aips)].into_iter().chain(of_learners);
    let tables = tables.map(|(name, table)| Ok((name, flat(Dtype::F32, bytemuck::cast_slice(table.as_slice()))?)));
    let mut tensors: Tensors<'_> = tables.collect::<Result<_>>()?;
    tensors.insert(STREAMS.to_owned(), flat(Dtype::U8, &streams)?);
    if owner.config.learning.learns_outside() {
        tensors.insert(OUTSIDE.to_owned(), flat(Dtype::U8, &learners.bytes)?);
    }
    if owner.config.learning.predicts_outside() {
        tensors.insert(OUTSIDE_AIPS.to_owned(), flat(Dtype::U8, outside_aips)?);
    }
    let metadata = seal(serde_json::to_string(&about)?, &tensors);
    // Directly to the file: the tables of a hundred agents need no second copy in memory.
    let write = |beside: &Path| Ok(safetensors::serialize_to_file(tensors, Some(metadata), beside)?);
    folder.write_with(&name_of(agents.steps), write)?;
    remove_old(folder)
}

/// Removes the checkpoints that are no longer kept. A process that is killed at it leaves some.
pub(crate) fn remove_old(folder: &Directory) -> Result<()> {
    let all = list(folder)?;
    all[..all.len().saturating_sub(KEPT)].iter().try_for_each(|old| folder.remove(old))
}

impl Checkpoint {
    /// Reads a checkpoint of a run. Errors say what to do; that of a checkpoint of another run is a [`NotOfThisRun`].
    pub fn read(folder: &Directory, name: &str, owner: &Owner) -> Result<Checkpoint> {
        let bytes = folder.read(name, LARGEST_FILE)?.unwrap_or_default();
        let read = || {
            let checkpoint = Checkpoint::from_bytes(&bytes, owner)?;
            let (inside, outside) = (checkpoint.agents.steps, steps_of(name));
            ensure!(Some(inside) == outside, "its name is not that of step {inside}, which it holds");
            Ok(checkpoint)
        };
        let path = folder.path_of(name);
        read().map_err(|error: anyhow::Error| match error.downcast::<NotOfThisRun>() {
            Ok(NotOfThisRun(reason)) => NotOfThisRun(format!("{}: {reason}", path.display())).into(),
            Err(error) => {
                let before = list(folder).is_ok_and(|names| names.first().is_some_and(|first| first != name));
                let advice = if before {
                    "cannot be resumed from; move it away to continue from the checkpoint before it"
                } else {
                    "cannot be resumed from, and there is no checkpoint before it; put it back from a copy, or begin the \
                     run again"
                };
                error.context(format!("{}: {advice}", path.display()))
            }
        })
    }

    /// Reads a checkpoint of a run from the bytes of its file.
    pub fn from_bytes(bytes: &[u8], owner: &Owner) -> Result<Checkpoint> {
        let (about, tensors) = unseal(bytes)?;
        let about: Metadata = serde_json::from_value(about).context("its metadata cannot be read")?;
        let Metadata { version, steps, config, scenario, progress, .. } = about;
        let config = from_json(config).with_context(|| {
            format!("its config cannot be read; if dials-traffic {version} wrote it, continue with that")
        })?;
        owner.check(&config, &scenario, progress.standing.until)?;

        let layouts: Vec<Layout> = owner
            .kinds
            .iter()
            .map(|kind| algorithms::of(&config.learning).layout(&config.learning, kind, steps))
            .collect();
        let names = layouts[0].numbers.iter().map(|table| format!("{LEARNERS}{}", table.name));
        let predicts_outside = config.learning.predicts_outside();
        let of_bytes = layouts[0].bytes.then_some(OUTSIDE).into_iter().chain(predicts_outside.then_some(OUTSIDE_AIPS));
        check_names(&tensors, [POLICIES, AIPS].map(str::to_owned).into_iter().chain(names), of_bytes)?;
        let widths = Widths::of(&owner.config.learning, &owner.kinds);
        let numbers = layouts[0].numbers.iter().enumerate().map(|(index, table)| {
            let of_agent = |agent| layouts[owner.kinds.place(agent).kind].numbers[index].width;
            let widths: Vec<usize> = AgentId::all(owner.kinds.agents()).into_iter().map(of_agent).collect();
            Ok((table.name.to_owned(), rows(&tensors, &format!("{LEARNERS}{}", table.name), &widths)?))
        });
        let numbers = numbers.collect::<Result<_>>()?;
        let ((streams, dice, counts), rest) = postcard::take_from_bytes::<Streams>(tensors[STREAMS].data())
            .context("the state of training cannot be read")?;
        ensure!(rest.is_empty(), "it has {} bytes after the state of training", rest.len());
        let bytes_of = |name: &str| tensors.get(name).map_or(Vec::new(), |bytes| bytes.data().to_vec());
        let bytes = bytes_of(OUTSIDE);
        let agents = AgentsState {
            steps,
            policies: rows(&tensors, POLICIES, &widths.policies)?,
            learners: Tables { numbers, dice, counts, bytes },
            aips: rows(&tensors, AIPS, &widths.aips)?,
            streams,
            outside_aips: bytes_of(OUTSIDE_AIPS),
        };
        progress.standing.check(&agents, progress.elapsed_s, &config.learning)?;
        let everybody = 0..owner.kinds.agents();
        let fit = Fit { config: &config.learning, kinds: &owner.kinds, widths: &widths, agents: everybody };
        fit.check(&agents)?;
        fit.check_numbers(&agents)?;
        let unknown = progress.growing.keys().find(|name| !files::GROWING.contains(&name.as_str()));
        ensure!(unknown.is_none(), "it counts the bytes of a file that no run has");
        Ok(Checkpoint { agents, progress })
    }
}

// The metadata of the file has two keys. `checkpoint` is the text of a JSON object. `digest` is the SHA-256 of that text and
// of each tensor's name, type, shape and bytes: a file that was changed anywhere is an error, or read as if it had not been.
const TEXT: &str = "checkpoint";
const DIGEST: &str = "digest";

pub type Tensors<'a> = BTreeMap<String, TensorView<'a>>;

/// Makes a tensor of one dimension.
pub fn flat(dtype: Dtype, bytes: &[u8]) -> Result<TensorView<'_>> {
    Ok(TensorView::new(dtype, vec![bytes.len() / (dtype.bitsize() / 8)], bytes)?)
}

/// Returns the metadata of a checkpoint with this text and these tensors.
pub fn seal(text: String, tensors: &Tensors<'_>) -> HashMap<String, String> {
    let digest = digest(&text, tensors);
    HashMap::from([(TEXT.to_owned(), text), (DIGEST.to_owned(), digest)])
}

/// Reads the text and the tensors of a checkpoint with the metadata of [`seal`].
fn unseal(bytes: &[u8]) -> Result<(Value, Tensors<'_>)> {
    let file = SafeTensors::deserialize(bytes).context("it is cut short, or not a safetensors file")?;
    let (_, header) = SafeTensors::read_metadata(bytes)?;
    let metadata = header.metadata().as_ref().context("it is not a checkpoint")?;
    let text = metadata.get(TEXT).context("it is not a checkpoint")?;
    let about: Value = serde_json::from_str(text).context("its metadata is damaged")?;
    ensure!(about["format"] == FORMAT, "it is not a checkpoint of this version of dials-traffic");
    let tensors = file.tensors().into_iter().collect();
    let sealed = metadata.get(DIGEST).context("it has no digest")?;
    ensure!(digest(text, &tensors) == *sealed, "its digest is wrong: it is damaged");
    ensure!(metadata.len() == 2, "it has metadata that no checkpoint has");
    Ok((about, tensors))
}

/// Every field is preceded by its length, so that no two checkpoints give the same bytes to the digest.
fn digest(text: &str, tensors: &Tensors<'_>) -> String {
    let mut hasher = Sha256::new();
    let mut field = |bytes: &[u8]| {
        hasher.update((bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    field(text.as_bytes());
    for (name, tensor) in tensors {
        field(name.as_bytes());
        field(format!("{:?} {:?}", tensor.dtype(), tensor.shape()).as_bytes());
        field(tensor.data());
    }
    hasher.finalize().iter().fold("sha256:".to_owned(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("a String takes everything");
        text
    })
}

/// Checks that there are tables with these names, the streams, and nothing else. `outside`: names of the bytes of a learner
/// and of a predictor outside.
fn check_names<'a>(
    tensors: &Tensors<'_>,
    tables: impl Iterator<Item = String>,
    outside: impl Iterator<Item = &'a str>,
) -> Result<()> {
    let bytes = [STREAMS].into_iter().chain(outside).map(|name| (name.to_owned(), Dtype::U8));
    let expected: BTreeMap<String, Dtype> = tables.map(|name| (name, Dtype::F32)).chain(bytes).collect();
    for (name, dtype) in &expected {
        let tensor = tensors.get(name).with_context(|| format!("it has no tensor `{name}`"))?;
        ensure!(
            tensor.dtype() == *dtype && tensor.shape().len() == 1,
            "its tensor `{name}` is {:?} {:?}, not {dtype:?} of one dimension",
            tensor.dtype(),
            tensor.shape()
        );
    }
    ensure!(tensors.len() == expected.len(), "it has tensors that no checkpoint of this run has");
    Ok(())
}

fn rows(tensors: &Tensors<'_>, name: &str, widths: &[usize]) -> Result<Ragged<f32>> {
    let values = tensors[name].data().as_chunks::<4>().0;
    let expected: usize = widths.iter().sum();
    ensure!(
        values.len() == expected,
        "its table `{name}` has {} values, and the {} agents of this run have {expected}",
        values.len(),
        widths.len()
    );
    let values = values.iter().map(|&value| f32::from_le_bytes(value)).collect();
    Ok(Ragged::from_vec(values, widths.iter().copied()).expect("their number was compared"))
}

fn name_of(steps: u64) -> String {
    format!("step_{steps:012}.safetensors")
}

/// Returns the timesteps of a file with exactly such a name. All other files are somebody else's.
fn steps_of(name: &str) -> Option<u64> {
    let steps = name.strip_prefix("step_")?.strip_suffix(".safetensors")?.parse().ok()?;
    (name_of(steps) == name).then_some(steps)
}

/// Lists the names of the checkpoints of a folder, oldest first.
pub fn list(folder: &Directory) -> Result<Vec<String>> {
    let names = folder.names()?.into_iter().filter_map(|name| name.into_string().ok());
    let mut found: Vec<(u64, String)> = names.filter_map(|name| Some((steps_of(&name)?, name))).collect();
    found.sort();
    Ok(found.into_iter().map(|(_, name)| name).collect())
}

/// Returns the timesteps per agent of the newest checkpoint of a run. `None`: it has none yet.
pub fn newest_step(run: &Directory) -> Result<Option<u64>> {
    let Some(folder) = run.subdirectory(files::CHECKPOINTS)? else { return Ok(None) };
    Ok(list(&folder)?.last().and_then(|name| steps_of(name)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_testkit::toy::Coins;

    fn place() -> (tempfile::TempDir, Directory, Owner) {
        let dir = tempfile::tempdir().unwrap();
        let owner = Owner::of(&crate::config::RunConfig::default(), &Coins::new(4)).unwrap();
        let folder = Directory::open(dir.path()).unwrap();
        (dir, folder, owner)
    }

    #[test]
    fn the_newest_three_are_kept_and_names_are_compared_as_numbers() {
        let (_dir, folder, owner) = place();
        for steps in [900, 1_000, 20_000, 999_999_999_999, 1_000_000_000_000] {
            let agents = AgentsState { steps, ..AgentsState::nobody() };
            write(&folder, &owner, &agents, RunProgress::default()).unwrap();
        }
        assert_eq!(list(&folder).unwrap(), [20_000, 999_999_999_999, 1_000_000_000_000].map(name_of));
    }

    #[test]
    fn a_damaged_checkpoint_that_is_the_only_one_says_so() {
        let (_dir, folder, owner) = place();
        folder.write(&name_of(128), b"mine").unwrap();
        let error = format!("{:#}", Checkpoint::read(&folder, &name_of(128), &owner).err().unwrap());
        assert!(error.contains(", and there is no checkpoint before it; put it back from a copy"), "{error}");
    }
}
